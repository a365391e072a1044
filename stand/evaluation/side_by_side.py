"""Two recordings of one procedure beside each other: estimates, means per stretch, noise.

Simulated against real, one unit against another, before against after.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from alignment import ESTIMATORS, AttitudeEstimate, Dwell, ImuReadings
from alignment.arrays import Array, set_owned
from alignment.errors import Fault
from alignment.estimate import determined
from alignment.noise import BLOCKS, low_density, mean_and_variance
from alignment.units import DEG
from stand.errors import StandError, unknown
from stand.evaluation.aligned import Alignment, align
from stand.evaluation.score import Refusal
from stand.imu import ImuSpec
from stand.recording.log import Log


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StretchPair:
    """One stretch in both: rates [rad/s], forces [m/s^2].

    Attributes
    ----------
    label, label_b : str
    means : (2, 6)
    variances : (2, 6)
        Of the means, by what each record shows at low frequency.
    densities : (2, 6)
        Of white noise, square roots [rad/sqrt(s)], [m/s/sqrt(s)].
    seconds : (2,)
    """

    label: str
    label_b: str
    means: Array
    variances: Array
    densities: Array
    seconds: Array

    def __post_init__(self) -> None:
        set_owned(
            self,
            means=(self.means, (2, 6), float),
            variances=(self.variances, (2, 6), float),
            densities=(self.densities, (2, 6), float),
            seconds=(self.seconds, (2,), float),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EstimatePair:
    """One estimate of both: `b` minus `a` is `off` (3,) [rad], a small rotation about n, with its
    `sigmas` (3,) where both have one."""

    a: AttitudeEstimate
    b: AttitudeEstimate
    off: Array
    sigmas: Array | None

    def __post_init__(self) -> None:
        set_owned(self, off=(self.off, (3,), float))
        if self.sigmas is not None:
            set_owned(self, sigmas=(self.sigmas, (3,), float))

    @property
    def undetermined(self) -> tuple[bool, ...]:
        """Whether `off` about north, east, down is not determined."""
        level = (True, True) if self.sigmas is None else determined(self.sigmas[:2]).tolist()
        return (*(not told for told in level), self.turned_unknown)

    @property
    def turned_unknown(self) -> bool:
        """Whether `off` about down is not determined, for one heading is not."""
        return any({"yaw", "heading"} & set(one.undetermined) for one in (self.a, self.b))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SideBySide:
    """Two recordings beside each other; `notes` say how they were matched, what was left out;
    `noise_only`: sensors of which, in one of them, nothing but noise is known."""

    a: Log
    b: Log
    stretches: tuple[StretchPair, ...]
    estimates: tuple[EstimatePair, ...]
    refusals: tuple[Refusal, ...]
    notes: tuple[str, ...]
    noise_only: frozenset[str]


def side_by_side(
    a: Log,
    b: Log,
    methods: Sequence[str] = (),
    *,
    imu: str | ImuSpec | None = None,
    latitude_deg: float | None = None,
) -> SideBySide:
    """Set two recordings of one procedure side by side.

    Stretches are matched by their names; in order where no name is in both and there are as many.

    Parameters
    ----------
    a, b : Log
    methods : sequence of str
        Of `ESTIMATORS`; none: those of both recordings, or of the first.
    imu : str or ImuSpec, optional
        Whose data sheet enters the sigmas of both; else as recorded.
    latitude_deg : float, optional
        Of both; else as recorded, or as the other has it.

    Raises
    ------
    StandError
        Stretches that cannot be matched; a method that is not known.
    """
    for method in methods:
        if method not in ESTIMATORS:
            raise unknown("method", method, ESTIMATORS)
    pairs, notes = _matched(a, b)
    named = _renamed(b, {two.label: one.label for one, two in pairs})
    wanted = methods or [m for m in a.methods if m in b.methods] or a.methods
    estimates: list[EstimatePair] = []
    refusals: list[Refusal] = []
    noise_only: frozenset[str] = frozenset()
    for method in wanted:
        found: list[Alignment] = []
        for log, other in ((a, named), (named, a)):
            try:
                found.append(_estimates(log, other, method, imu, latitude_deg))
            except Fault as error:
                refusals.append(Refusal(method, str(error)))
        if len(found) == 2:
            estimates += _paired(*(one.estimates for one in found))
            noise_only = noise_only.union(*(one.noise_only for one in found))
    return SideBySide(
        a=a,
        b=b,
        stretches=tuple(_stretch(one, two) for one, two in pairs),
        estimates=tuple(estimates),
        refusals=tuple(refusals),
        notes=notes,
        noise_only=noise_only,
    )


def _matched(a: Log, b: Log) -> tuple[list[tuple[Dwell, Dwell]], tuple[str, ...]]:
    """Dwells that belong together, and what to say of the matching."""
    there = {dwell.label: dwell for dwell in b.dwells}
    pairs = [(dwell, there[dwell.label]) for dwell in a.dwells if dwell.label in there]
    if pairs:
        both = {one.label for one, _ in pairs}
        alone = [d.label for log in (a, b) for d in log.dwells if d.label not in both]
        return pairs, (f"in one of them alone: {', '.join(alone)}",) if alone else ()
    if len(a.dwells) != len(b.dwells):
        raise StandError(
            f"{a.path} has {len(a.dwells)} stretches, {b.path} {len(b.dwells)}, and no name is in "
            "both: name them alike (stand stretches, --stretches)"
        )
    return list(zip(a.dwells, b.dwells, strict=True)), ("stretches matched by their order",)


def _renamed(log: Log, names: dict[str, str]) -> Log:
    """The log with the names that its stretches have in the other; those alone are left out."""
    kept = [k for k, dwell in enumerate(log.dwells) if dwell.label in names]
    dwells = tuple(replace(log.dwells[k], label=names[log.dwells[k].label]) for k in kept)
    return replace(log, dwells=dwells, truths=tuple(log.truths[k] for k in kept))


def _estimates(
    log: Log, other: Log, method: str, imu: str | ImuSpec | None, latitude_deg: float | None
) -> Alignment:
    if latitude_deg is None and log.site.latitude is None and other.site.latitude is not None:
        latitude_deg = other.site.latitude / DEG
    return align([log], method, imu=imu, latitude_deg=latitude_deg)


def _paired(
    first: Sequence[AttitudeEstimate], second: Sequence[AttitudeEstimate]
) -> list[EstimatePair]:
    there = {(e.label, e.window): e for e in second}
    return [
        _pair(one, other)
        for one in first
        if (other := there.get((one.label, one.window))) is not None
        and one.C_nb is not None
        and other.C_nb is not None
    ]


def _pair(a: AttitudeEstimate, b: AttitudeEstimate) -> EstimatePair:
    assert a.C_nb is not None
    assert b.C_nb is not None
    sigmas = None
    if a.covariance is not None and b.covariance is not None:
        sigmas = np.sqrt(np.diag(a.covariance) + np.diag(b.covariance))
    return EstimatePair(a=a, b=b, off=(b.C_nb * a.C_nb.inv()).as_rotvec(), sigmas=sigmas)


def _stretch(one: Dwell, two: Dwell) -> StretchPair:
    windows = one.window(), two.window()
    found = [mean_and_variance(window) for window in windows]
    densities = [np.sqrt(_densities(w) * w.interval) for w in windows]
    return StretchPair(
        label=one.label,
        label_b=two.label,
        means=np.array([means for means, _ in found]),
        variances=np.array([variances for _, variances in found]),
        densities=np.array(densities),
        seconds=np.array([d.t_to - d.t_from for d in (one, two)]),
    )


def _densities(w: ImuReadings) -> Array:
    """Of the noise of rates and forces (6,), per sample."""
    if len(w) <= BLOCKS:
        return np.concatenate([w.w_ib_b.var(axis=0), w.f_b.var(axis=0)])
    return np.concatenate([low_density(w.w_ib_b), low_density(w.f_b)])


def side_by_side_json(found: SideBySide) -> dict[str, Any]:
    """For machines."""
    return {
        "a": found.a.path,
        "b": found.b.path,
        "notes": list(found.notes),
        "stretches": [
            {
                "label": s.label,
                "label_b": s.label_b,
                "seconds": s.seconds.tolist(),
                "means_rad_s_m_s2": s.means.tolist(),
                "sigmas_of_means": np.sqrt(s.variances).tolist(),
                "noise_rad_rt_s_m_s_rt_s": s.densities.tolist(),
            }
            for s in found.stretches
        ],
        "estimates": [
            {
                "method": e.a.method,
                "window": e.a.window,
                "label": e.a.label,
                "off_ned_deg": [
                    None if none else float(off) / DEG
                    for off, none in zip(e.off, e.undetermined, strict=True)
                ],
                "noise_only": bool(found.noise_only),
                "sigmas_deg": None if e.sigmas is None else (e.sigmas / DEG).tolist(),
            }
            for e in found.estimates
        ],
        "refusals": [{"method": r.method, "reason": r.reason} for r in found.refusals],
    }
