"""The whole answer of a rehearsal, as data, and its JSON form.

Angles and biases are in SI inside; each prediction says in which unit it is told (`unit`, `per`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import hypot, inf, sqrt
from pathlib import Path

from alignment.units import DEG
from stand.rehearsal.rocking_allowed import AdmissibleRocking
from stand.rehearsal.verification import Verification

QUANTITIES = ("heading", "pitch", "roll")  # what a requirement may name


class Verdict(StrEnum):
    """What a requirement comes to; of the whole also CONTRADICTED, by runs beside predictions."""

    CONTRADICTED = "CONTRADICTED"
    PASS = "PASS"
    FAIL = "FAIL"
    INDETERMINATE = "INDETERMINATE"


class Severity(StrEnum):
    """Of a finding: an error forbids the run, a warning is for a person to judge."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Margin:
    """What a step uses of one limit, at its greatest.

    Attributes
    ----------
    quantity : str
        'angle', 'rate', 'acceleration', 'jerk', 'torque', 'settling', 'sensor rate', 'sensor
        force', 'sampling', 'filter'.
    axis : str
        A joint, a sensor ('gyro X1'), or ''.
    value, limit : float
        In `unit`.
    unit : str
    ratio : float
        Of the limit that is used: above 1 it is broken.
    t : float or None
        When it is greatest [s].
    first_violation : float or None
        When it is first broken [s]; None where it is kept.
    """

    quantity: str
    axis: str
    value: float
    limit: float
    unit: str
    ratio: float
    t: float | None = None
    first_violation: float | None = None

    @property
    def kept(self) -> bool:
        """Whether the limit is not broken."""
        return self.first_violation is None

    @property
    def margin(self) -> float:
        """Part of the limit that is left, negative where it is broken."""
        return 1 - self.ratio


@dataclass(frozen=True, slots=True)
class StepFeasibility:
    """One step: its margins, and how long the table takes to settle in it.

    `number` counts from 1; `settling_s` None where it neither rests nor turns steadily, or where
    the class states no motor. `turns`: whole turns wound up on each axis that has limited travel,
    by name. `joints`: where the table stands at the end of the step, [rad] in the order of
    `stand.table.joints.JOINTS`: the report draws it.
    """

    number: int
    kind: str
    label: str
    t_from: float
    t_to: float
    margins: tuple[Margin, ...]
    settling_s: float | None
    turns: Mapping[str, float]
    joints: tuple[float, ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept."""
        return all(m.kept for m in self.margins)

    @property
    def worst(self) -> Margin | None:
        """The margin nearest to its limit, or farthest beyond it."""
        return max(self.margins, key=lambda m: m.ratio, default=None)


@dataclass(frozen=True, slots=True)
class StepDuration:
    """How long a step takes: `motion`, `settling` of its rest, `dwell` after that, all [s]."""

    number: int
    kind: str
    label: str
    t_from: float
    t_to: float
    motion: float
    settling: float
    dwell: float


@dataclass(frozen=True, slots=True)
class Duration:
    """The duration table, and the sums [s]."""

    steps: tuple[StepDuration, ...]

    @property
    def motion(self) -> float:
        """Of the table's moving between what is measured."""
        return sum(s.motion for s in self.steps)

    @property
    def settling(self) -> float:
        """Of waiting for the servo."""
        return sum(s.settling for s in self.steps)

    @property
    def dwell(self) -> float:
        """Of measuring."""
        return sum(s.dwell for s in self.steps)

    @property
    def total(self) -> float:
        """Of the procedure."""
        return self.steps[-1].t_to if self.steps else 0.0


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one source of error adds, in SI; they add up in quadrature.

    `sigma` of what is drawn; of what is known, the size of the bias it makes.
    """

    source: str
    sigma: float


@dataclass(frozen=True, slots=True)
class Prediction:
    """How sure one method will be of one quantity in one stretch.

    Attributes
    ----------
    method, window, label : str
        As the estimate will be called ('six-position', 'fresh', 'X1 up').
    quantity : str
        'heading', 'roll', 'yaw', 'pitch', or a bias such as 'gyro bias X1'.
    unit, per : str, float
        What it is told in, and its size in SI.
    sigma : float or None
        Standard deviation [SI] by all that is drawn anew in each run; None where it is not
        determined.
    contributions : tuple of Contribution
        The largest first; root of the sum of squares is `rms`. Empty where not determined.
    reason : str
        Why it is not determined; '' where it is.
    bias : float
        The same in every run [SI]: by the table's errors that the procedure sets.
    beyond : float
        What first order has it at [SI] where that is too much to be a number.
    assumed : float
        The part of sigma [SI] by sizes that no sheet states: they were assumed, and no run has
        such an error.
    noise_only : bool
        Whether no sheet states more than noise of the sensors that tell it.
    """

    method: str
    window: str
    label: str
    quantity: str
    unit: str
    per: float
    sigma: float | None
    contributions: tuple[Contribution, ...]
    reason: str = ""
    bias: float = 0.0
    beyond: float = inf
    assumed: float = 0.0
    noise_only: bool = False

    @property
    def rank(self) -> tuple[bool, float]:
        """By which predictions are better or worse: those with a number before those without."""
        return not self.determined, self.beyond if self.rms is None else self.rms

    @property
    def rms(self) -> float | None:
        """Root mean square of the error: sigma and bias in quadrature [SI]."""
        return None if self.sigma is None else hypot(self.sigma, self.bias)

    @property
    def drawn(self) -> float | None:
        """The root mean square that runs come to [SI]: without what was `assumed`."""
        return None if self.rms is None else sqrt(max(self.rms**2 - self.assumed**2, 0.0))

    @property
    def determined(self) -> bool:
        """Whether there is a number to stand behind."""
        return self.sigma is not None


@dataclass(frozen=True, slots=True)
class Observability:
    """What the readings that a method uses can tell at all, before any data sheet.

    `rank` of `sought` unknowns (attitude and biases); `condition` of the Fisher matrix over what
    it determines; `unseen`: in words, what cannot be told apart.
    """

    method: str
    rank: int
    sought: int
    condition: float
    unseen: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Judgement:
    """A requirement and what is predicted for it.

    Attributes
    ----------
    quantity : str
        One of `QUANTITIES`.
    method, label : str
        The method it is judged by, and the stretch in which that is worst; '' where none says
        anything of it.
    required : float
        [rad]
    coverage : float
        The expanded uncertainty is `coverage` times the root mean square of sigma and bias: with a
        coverage of 2 it holds in 95 % however they share it.
    sigma : float or None
        [rad]; None where it is not determined.
    guard : float
        Part of the requirement within which nobody can say: how far a prediction may be off.
    verdict : Verdict
    reason : str
    bias : float
        Of the table's known errors [rad].
    beyond : float
        Of a prediction without a number: what first order has it at [rad].
    unit, per : str, float
        What it is told in, and that in SI; of a constant of the unit all numbers here are in SI.
    refused : bool
        Whether no procedure on this table can keep it: `reason` says why.
    noise_only : bool
        As of the `Prediction` that it is judged by.
    """

    quantity: str
    method: str
    label: str
    required: float
    coverage: float
    sigma: float | None
    guard: float
    verdict: Verdict
    reason: str = ""
    bias: float = 0.0
    beyond: float = inf
    unit: str = "deg"
    per: float = DEG
    refused: bool = False
    noise_only: bool = False

    @property
    def rms(self) -> float | None:
        """Sigma and bias in quadrature [rad]."""
        return None if self.sigma is None else hypot(self.sigma, self.bias)

    @property
    def expanded(self) -> float | None:
        """Coverage times the root mean square [rad]."""
        return None if self.rms is None else self.coverage * self.rms


@dataclass(frozen=True, slots=True)
class Change:
    """One number of the procedure that an advice changes: 'step 3 "first", duration_s'."""

    where: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class Advice:
    """The cheapest change that makes a quantity pass: with what comes of it.

    `toml` is the whole procedure with the change applied; `duration` [s] of it, `sigma` [rad] of
    the quantity in it, `noise_only` as of its `Judgement`. `text` for a person. A quantity that no
    change found can help has `toml` ''.
    """

    quantity: str
    text: str
    changes: tuple[Change, ...]
    sigma: float | None
    duration: float | None
    toml: str = ""
    noise_only: bool = False

    @property
    def helps(self) -> bool:
        """Whether it would pass with this change."""
        return bool(self.toml)


FROM_SHEET = "data sheet"  # the kind of a finding that tells what a sheet leaves out


@dataclass(frozen=True, slots=True)
class Finding:
    """A trap or a doubt, told before the run: `kind` for machines, `text` for a person."""

    severity: Severity
    kind: str
    step: str
    text: str


@dataclass(frozen=True, slots=True)
class Inputs:
    """What was rehearsed: ids, titles, texts and their SHA-256, site, versions.

    `latitude_deg`, `height_m`; `rate_hz` of the readings; `revision` of the part, '' if not said.
    `model`: the MJCF of a stand of one's own.
    """

    procedure: str
    procedure_title: str
    procedure_text: str
    imu: str
    imu_title: str
    imu_text: str
    table: str
    table_title: str
    table_text: str
    latitude_deg: float
    height_m: float
    rate_hz: int
    revision: str
    sha256: Mapping[str, str]
    versions: Mapping[str, str]
    model: Path | None = None


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """The whole answer.

    `feasibility` step by step; `duration`; `predictions` of every method, stretch and quantity;
    `observability` of every method; `judgements` of what is required; `advice` for each that
    fails; `findings`: traps and doubts, errors first; `verification` where runs were asked for;
    `rocking` of the base that methods admit, where it rocks and a heading is required.
    """

    inputs: Inputs
    feasibility: tuple[StepFeasibility, ...]
    duration: Duration
    predictions: tuple[Prediction, ...]
    observability: tuple[Observability, ...]
    judgements: tuple[Judgement, ...]
    advice: tuple[Advice, ...]
    findings: tuple[Finding, ...]
    verification: Verification | None = None
    rocking: tuple[AdmissibleRocking, ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether the table can make every step and no finding forbids the run."""
        errors = any(f.severity is Severity.ERROR for f in self.findings)
        return not errors and all(step.feasible for step in self.feasibility)

    @property
    def accurate(self) -> bool:
        """Whether everything required is predicted to pass."""
        return all(j.verdict is Verdict.PASS for j in self.judgements)

    @property
    def verdict(self) -> Verdict:
        """Of the whole: FAIL where anything fails, INDETERMINATE where anything is open.

        CONTRADICTED where runs contradict a prediction: nothing that rests on it holds.
        """
        if self.verification is not None and self.verification.contradicts:
            return Verdict.CONTRADICTED
        open_ones = {j.verdict for j in self.judgements}
        if not self.feasible or Verdict.FAIL in open_ones:
            return Verdict.FAIL
        return Verdict.INDETERMINATE if Verdict.INDETERMINATE in open_ones else Verdict.PASS
