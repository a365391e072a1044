"""All that decides a run, assembled in one place.

Every command and every function of `stand.api` takes `Settings`; nobody else puts together what
an estimator is told.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import hypot
from numbers import Real
from pathlib import Path
from typing import Never

import numpy as np

from alignment import ESTIMATORS, Options, Priors, Site
from alignment.angles import SequenceRule
from alignment.calibration.bench import WIDE, freed
from stand.arguments import (
    ALLAN_TERMS,
    HIGHEST_RATE_HZ,
    Named,
    entry_name,
    one_of,
    refuse_mistaken,
    site_with,
    words,
)
from stand.errors import StandError, unknown, whole
from stand.imu import ImuSpec, Temperature, load_imu, without
from stand.imu.instrument import slow_noise
from stand.imu.priors import BASE_ARM, GIMBAL_ARM, priors_of
from stand.motion.polynomial import MotionKind
from stand.physics.dynamics import Payload
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import Procedure, load_procedure, table_of
from stand.procedure.requirements import terms_of
from stand.samples import Sampling
from stand.simulation.benches import bench_of
from stand.simulation.warmth import observed_for, warmed
from stand.table.kinematics import base_arm, gimbal_arm
from stand.table.table import Table, load_table, without_errors
from stand.table.table_errors import TableErrors, TableErrorsEntry, draw


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Settings:
    """All that decides a run: same settings, same bytes of `run.mcap`.

    Made by `settings` or `assembled`, which tell the estimators what the data sheets say.

    Attributes
    ----------
    procedure : Procedure
    imu : ImuSpec
        As its data sheet says; `unit` is what is simulated.
    table : Table
    site : Site
    options : Options
        What the estimators are told, priors included.
    rate_hz : int
    sampling : Sampling
    seed : int
        Of the unit, the table and a sway that is drawn.
    without : tuple of str
        Error terms of the unit that are switched off.
    motion : MotionKind
        Whether the joints follow the plan or are moved by a simulated servo.
    true_table : bool
        Whether the table is without errors.
    methods : tuple of str, optional
        Ids of `ESTIMATORS`; None for those of the procedure.
    revision : str
        Of the part, for requirements that depend on it.
    allan_terms : tuple of str
        Terms that the record is to show, of `ALLAN_TERMS`.
    """

    procedure: Procedure
    imu: ImuSpec
    table: Table
    site: Site
    options: Options
    rate_hz: int = 200
    sampling: Sampling = Sampling.MEAN
    seed: int = 0
    without: tuple[str, ...] = ()
    motion: MotionKind = MotionKind.IDEAL
    true_table: bool = False
    methods: tuple[str, ...] | None = None
    revision: str = ""
    allan_terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.rate_hz, Real):
            raise StandError(f"rate = {self.rate_hz!r}: must be a whole number of Hz")
        if self.rate_hz != int(self.rate_hz):
            raise StandError(f"rate = {self.rate_hz:g} Hz: must be a whole number")
        if not 1 <= self.rate_hz <= HIGHEST_RATE_HZ:
            raise StandError(f"rate = {self.rate_hz} Hz: must be 1 to {HIGHEST_RATE_HZ}")
        whole("seed", self.seed)
        if not isinstance(self.true_table, bool):
            raise StandError(f"true_table = {self.true_table!r}: must be True or False")
        for method in self.methods or ():
            if method not in ESTIMATORS:
                raise unknown("method", method, ESTIMATORS)
        for term in self.allan_terms:
            if term not in ALLAN_TERMS:
                raise unknown("term", term, ALLAN_TERMS)

    def __repr__(self) -> str:
        changed = f", without {', '.join(self.without)}" if self.without else ""
        true = " without errors" if self.true_table else ""
        return (
            f"Settings: {self.procedure.id}, {self.imu.id}{changed}, {self.table.id}{true}, "
            f"{self.rate_hz} Hz ({self.sampling.value}), {self.motion.value}, seed {self.seed}"
        )

    @property
    def unit(self) -> ImuSpec:
        """The unit that is simulated: `imu` less the terms that are switched off."""
        return without(self.imu, self.without) if self.without else self.imu

    @property
    def stated_table(self) -> Table:
        """The table as its errors are stated: of `true_table` none."""
        return without_errors(self.table) if self.true_table else self.table


def settings(
    procedure: Named | Procedure,
    imu: Named | ImuSpec = "stim300",
    table: Named | Table | None = None,
    *,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    rate_hz: int = 200,
    sampling: str = "mean",
    seed: int = 0,
    without: Sequence[str] = (),
    motion: str = "ideal",
    true_table: bool = False,
    methods: Sequence[str] | None = None,
    sequences: str | None = None,
    revision: str = "",
    allan_terms: Sequence[str] = (),
    **mistaken: Never,
) -> Settings:
    """Everything that decides a run, a comparison or a rehearsal.

    Parameters
    ----------
    procedure : str, path or Procedure
        Id of the catalogue (``stand.catalogue("procedures")``) or a TOML file.
    imu : str, path or ImuSpec
        Unit: id (``stand.catalogue("imus")``) or a TOML file.
    table : str, path or Table, optional
        Table class: id (``stand.catalogue("tables")``) or a TOML file; else the procedure's own.
    latitude_deg, height_m : float, optional
        Of the site [deg], [m]; else the procedure's own.
    rate_hz : int
        Samples per second, 1 to 10000.
    sampling : str
        A sample is the ``"mean"`` over its interval or the ``"instant"`` at its end.
    seed : int
        Of the unit, the table and a sway that is drawn.
    without : sequence of str
        Error terms of the unit to switch off (``"turn-on-bias"``, ``"range"`` ...).
    motion : str
        Joints follow the plan (``"ideal"``) or as simulated motors make them (``"servo"``).
    true_table : bool
        A table without errors, whatever its class.
    methods : sequence of str, optional
        Ids (``stand.catalogue("methods")``); else the procedure's, and in a comparison all that
        apply.
    sequences : str, optional
        By which order of turns a position is read: ``"regular"`` or ``"published"``; else as the
        procedure says.
    revision : str
        Of the part, where what is required of it depends on that.
    allan_terms : sequence of str
        Noise terms (of N, B, K, Q, R) that a rehearsal is to find the rests long enough for.

    Returns
    -------
    Settings
        Frozen. Its ``options.priors`` say what unit and table class may do.

    Raises
    ------
    StandError
        In one line: what is wrong and what is allowed.

    Examples
    --------
    >>> import stand
    >>> s = stand.settings("six-position", imu="ring-laser", rate_hz=20, seed=3)
    >>> s.procedure.entry.title, s.table.id
    ('Six-position test', 'laboratory')
    >>> stand.settings("six-position", latitude_deg=95)
    Traceback (most recent call last):
        ...
    stand.errors.StandError: latitude = 95 deg: must be -90 to 90
    """
    refuse_mistaken(mistaken, settings)
    loaded = procedure
    if not isinstance(loaded, Procedure):
        loaded = load_procedure(entry_name("procedure", loaded))
    own_table = table
    if own_table is not None and not isinstance(own_table, Table):
        own_table = load_table(entry_name("table", own_table))
    options = loaded.entry.estimate.options()
    if sequences is not None:
        options = replace(options, rule=one_of("sequences", sequences, SequenceRule))
    return assembled(
        loaded,
        imu if isinstance(imu, ImuSpec) else load_imu(entry_name("imu", imu)),
        own_table,
        site_with(loaded.entry.site.site(), latitude_deg, height_m),
        rate_hz,
        options=options,
        sampling=one_of("sampling", sampling, Sampling),
        seed=seed,
        without=words("without", without),
        motion=one_of("motion", motion, MotionKind),
        true_table=true_table,
        methods=None if methods is None else words("methods", methods),
        revision=revision,
        allan_terms=tuple(t.upper() for t in words("allan_terms", allan_terms)),
    )


def assembled(
    procedure: Procedure,
    imu: ImuSpec,
    table: Table | None = None,
    site: Site | None = None,
    rate_hz: int = 200,
    *,
    options: Options | None = None,
    **rest: object,
) -> Settings:
    """Settings of what is loaded already, the estimators told what the data sheets say.

    `table`, `site` and `options` (whose priors are replaced) are the procedure's own if not
    given; `rest`: further fields of `Settings`.
    """
    choices = options or procedure.entry.estimate.options()
    plain = Settings(
        procedure=procedure,
        imu=imu,
        table=table or table_of(procedure),
        site=site or procedure.entry.site.site(),
        options=choices,
        rate_hz=rate_hz,
        **rest,  # pyright: ignore[reportArgumentType]  # checked by its fields
    )
    return replace(plain, options=_with_knowledge(choices, plain))


def with_procedure(made: Settings, procedure: Procedure) -> Settings:
    """The same with another procedure, whose options and rocking the estimators are told."""
    options = replace(procedure.entry.estimate.options(), rule=made.options.rule)
    changed = replace(made, procedure=procedure, options=options)
    return replace(changed, options=_with_knowledge(options, changed))


def options_for(made: Settings, methods: Sequence[str]) -> Options:
    """The options of settings as these methods need them, whoever the settings name."""
    return _with_knowledge(made.options, replace(made, methods=tuple(methods)))


def _with_knowledge(options: Options, made: Settings) -> Options:
    """Options with what unit and table may do: priors, and for a calibration all of it."""
    bench = None
    if any(ESTIMATORS[method].design is not None for method in methods_of(made)):
        ideal = made.motion is MotionKind.IDEAL
        bench = bench_of(
            made.unit,
            made.stated_table,
            made.site,
            made.sampling,
            made.rate_hz,
            ideal=ideal,
            temperature=temperature_of(made.procedure),
        )
        # what is required of a unit is looked for, though its sheet may not state it: wide, so
        # that the readings tell it and not the guess
        bench = freed(bench, terms_of(_required(made)), WIDE)
    return replace(options, priors=stated_priors(made), bench=bench)


def _required(made: Settings) -> Iterable[str]:
    require = made.procedure.entry.require
    if require is None:
        return ()
    return require.limits_for(made.imu.id, made.imu.entry.grade, made.revision)


def stated_priors(made: Settings) -> Priors:
    """What the estimators may know of a run: what its unit and its table class may do, and how
    warm it gets.

    Of a table without errors that is none; a base that rocks and an axis that turns move the unit,
    whoever built it.
    """
    arm = arm_of(made.procedure, made.table)
    noise = slow_noise(made.unit, made.rate_hz, made.sampling)
    priors = priors_of(made.unit, made.stated_table, arm, noise)
    temperature = temperature_of(made.procedure)
    if temperature is None:
        return priors
    return warmed(priors, made.unit, temperature, observed_for(made.procedure.entry))


def run_id(settings: Settings) -> str:
    """The default name of a run: procedure, unit, seed."""
    return f"{settings.procedure.id}_{settings.imu.id}_seed{settings.seed}"


def arm_of(procedure: Procedure, table: Table) -> float:
    """How far the unit is from the axes that move it while it is observed [m]."""
    entry, own = procedure.entry, table.model
    rocking, turning = (BASE_ARM, GIMBAL_ARM) if own is None else _arms(own)
    return hypot(rocking * entry.rocks, turning * entry.turns)


def _arms(model: Path) -> tuple[float, float]:
    described = describe(load_model(model))
    return base_arm(described), gimbal_arm(described)


def methods_of(settings: Settings) -> tuple[str, ...]:
    """What is to be estimated: the settings' own methods, or those of the procedure."""
    if settings.methods is not None:
        return settings.methods
    return settings.procedure.entry.estimate.methods


def follows_moves(settings: Settings) -> bool:
    """Whether a method needs what the unit reads between the stretches."""
    return any(ESTIMATORS[method].follows_moves for method in methods_of(settings))


def payload_of(procedure: Procedure) -> Payload:
    """What the procedure fixes to the plate beside the unit."""
    entry = procedure.entry.payload
    return Payload(entry.mass_kg, np.array(entry.offset_m))


def table_errors_of(settings: Settings) -> TableErrors:
    """What is wrong with the table in this run."""
    entry, ideal = settings.procedure.entry.table_errors, settings.motion is MotionKind.IDEAL
    if settings.true_table:
        entry = TableErrorsEntry(drawn=False)
    return draw(settings.table, settings.seed, entry, ideal)


def temperature_of(procedure: Procedure) -> Temperature | None:
    """The temperature over a run, where the procedure states one."""
    profile = procedure.entry.temperature
    if profile is None:
        return None
    return Temperature(np.array(profile.time_s), np.array(profile.temperature_C))
