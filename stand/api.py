"""The Python interface: what a notebook, a script and the command line call.

One function per job. What a command prints, its function returns; results print themselves as
tables. Each imports what it needs when it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Never

if TYPE_CHECKING:
    from stand.calibration.file import CalibrationRecord
    from stand.imu import ImuSpec
    from stand.imu.unit import Unit
    from stand.recording.log import Log
    from stand.recording.log_form import LogForm
    from stand.recovered import Recovered
    from stand.report.film import Film
    from stand.results.aligned import Aligned
    from stand.results.analysed import Analysed
    from stand.results.beside import Beside
    from stand.results.calibrated import Calibrated
    from stand.results.campaigned import Campaigned
    from stand.results.compared import Compared
    from stand.results.driven import Driven
    from stand.results.entries import Entries
    from stand.results.proposed import Proposed
    from stand.results.recorded import Recorded
    from stand.results.recording import Recording
    from stand.results.rehearsed import Rehearsed
    from stand.results.simulated import Simulated
    from stand.results.stretches import Stretches
    from stand.simulation.settings import Settings
    from stand.simulation.work import Engine
    from stand.table.table import Table

Named = str | PathLike[str]
Progress = Callable[[float], None]


def _quiet(done: float) -> None:
    """Progress that nobody watches."""


def _checked(settings: Settings) -> Settings:
    """The settings, which are no name of a procedure."""
    from stand.errors import StandError
    from stand.simulation.settings import Settings

    if not isinstance(settings, Settings):
        raise StandError(f"settings = {settings!r}: must be of stand.settings(...)")
    return settings


def simulate(settings: Settings, progress: Progress = _quiet) -> Simulated:
    """A run in memory: samples, truth, joints and the stretches to estimate from.

    Parameters
    ----------
    settings : Settings
        Of `stand.settings`.
    progress : callable
        Told the part done, 0 to 1.

    Returns
    -------
    Simulated
        Arrays in SI: ``t``, ``w_ib_b``, ``f_b``, ``true_w_ib_b``, ``true_f_b``, ``q_nb``,
        ``joints``; `stand.align` takes it as it is, ``array()`` and ``columns()`` give all of
        it to others.

    Raises
    ------
    StandError
        The plan is impossible on this table.

    Examples
    --------
    >>> import stand
    >>> run = stand.simulate(stand.settings("two-position", imu="ideal", rate_hz=5))
    >>> run.w_ib_b.shape, [d.label for d in run.stretches]
    ((3000, 3), ['first', 'second'])
    >>> float(abs(run.f_b - run.true_f_b).max())
    0.0
    """
    from stand.results.simulated import simulated

    return simulated(_checked(settings), progress)


def run(
    settings: Settings,
    out: Named | None = None,
    *,
    force: bool = False,
    progress: Progress = _quiet,
) -> Recorded:
    """Simulate, record, estimate, and score against the truth.

    Parameters
    ----------
    settings : Settings
        Of `stand.settings`. Same settings, same bytes of ``run.mcap``.
    out : path, optional
        Folder for ``run.mcap``, ``run.rrd`` and ``result.json``; else one of its own under
        ``recordings``.
    force : bool
        Replace a recording that is there.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        A recording is there; the folder cannot be written; the plan is impossible.

    Examples
    --------
    >>> import stand, tempfile
    >>> s = stand.settings("two-position", imu="ring-laser", rate_hz=2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result = stand.run(s, out=f"{folder}/a")
    ...     log = stand.read(f"{folder}/a")
    >>> result.samples, log.methods
    (1200, ('triad', 'two-position'))
    """
    from stand.recorded_run import run as record
    from stand.report.notebook import shown
    from stand.results.recorded import Recorded

    return shown(Recorded, record(_checked(settings), out, force, progress))


def drive(
    scenario: Named,
    imu: Named = "stim300",
    *,
    rate_hz: int = 200,
    seed: int = 0,
    out: Named | None = None,
    force: bool = False,
    progress: Progress = _quiet,
) -> Driven:
    """Drive a unit with satellite navigation along a path; correct its attitude, and record.

    Parameters
    ----------
    scenario, imu : str or path
        Ids (``stand.catalogue("trajectories")``, ``stand.catalogue("imus")``) or TOML files.
    rate_hz : int
        Samples per second, 20 to 10000.
    seed : int
    out : path, optional
        Folder for the recording; else one of its own under ``recordings``.
    force : bool
        Replace a recording that is there.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        As `stand.run`.

    Examples
    --------
    >>> import stand
    >>> stand.drive("weavin")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: unknown trajectory 'weavin': did you mean weaving? known: ...
    """
    from os import fspath

    from stand.evaluation.drive_result import DriveSettings
    from stand.imu import load_imu
    from stand.recorded_drive import run_drive
    from stand.report.notebook import shown
    from stand.results.driven import Driven
    from stand.vehicle.scenario import load_drive

    settings = DriveSettings(load_drive(fspath(scenario)), load_imu(fspath(imu)), rate_hz, seed)
    return shown(Driven, run_drive(settings, out, force, progress))


def read(
    path: Named,
    *,
    topic: str | None = None,
    t_from_s: float | None = None,
    t_to_s: float | None = None,
    turn_joint: str | None = None,
    turn_axis: Sequence[float] | None = None,
    moving: bool = False,
    start_attitude_deg: Sequence[float] | None = None,
    start_sigma_deg: float | None = None,
    fix_sigma: Sequence[float] | None = None,
    stretches: Named | None = None,
    form: LogForm | None = None,
    progress: Progress = _quiet,
) -> Recording:
    """A recording: ours, or a log of any kind.

    Parameters
    ----------
    path : path
        A file, a folder of `stand.run` or of a ROS 2 bag.
    topic : str, optional
        Of the IMU, where there are several.
    t_from_s, t_to_s : float, optional
        The stretch to use [s]; else what the recording says, or all of it.
    turn_joint : str, optional
        The table turns: the joint whose encoder counts.
    turn_axis : (3,), optional
        Axis of that turn in b; else the vertical.
    moving : bool
        It is a vehicle's, with satellite fixes; the next three say as much.
    start_attitude_deg : (3,), optional
        Roll, yaw, pitch as programmed at the first fix [deg].
    start_sigma_deg : float, optional
        How wrong that is about each axis [deg].
    fix_sigma : (2,), optional
        Noise of positions [m] and velocities [m/s]; else what the fixes state.
    stretches : path, optional
        A TOML file that names the log's stretches, with attitudes and turns, in place of the
        recording's own; `stand.stretches` finds them.
    form : stand.LogForm, optional
        Columns, units, axes and what else a log of others does not say itself.
    progress : callable
        Told the part read, 0 to 1.

    Raises
    ------
    StandError
        In one line: the file, what is wrong with it, what is allowed.

    Examples
    --------
    >>> import stand
    >>> stand.read("none.mcap")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: none.mcap: no such file
    """
    from stand.recording.log import load_log
    from stand.recording.named_stretches import load_stretches
    from stand.recording.vehicle_log import vehicle_of
    from stand.report.notebook import shown
    from stand.results.recording import Recording

    vehicle = vehicle_of(moving, start_attitude_deg, start_sigma_deg, fix_sigma)
    named = None if stretches is None else load_stretches(stretches)
    log = load_log(
        _path(path), topic, t_from_s, t_to_s, turn_joint, turn_axis, vehicle, named, form, progress
    )
    return shown(Recording, log)


def film(
    recording: Log | Named,
    out: Named,
    *,
    t_from_s: float | None = None,
    t_to_s: float | None = None,
    speed: float | None = None,
    camera: str = "review",
    size: tuple[int, int] = (1280, 720),
    method: str | None = None,
    joints: str = "",
    force: bool = False,
    progress: Progress = _quiet,
) -> Film:
    """The moving stand beside its readings and its estimate, as a film.

    Parameters
    ----------
    recording : Recording or path
        Of `stand.run`, or a log with joint angles.
    out : path
        ``.mp4``, ``.gif`` or ``.webp``.
    t_from_s, t_to_s : float, optional
        What is shown [s]; else all.
    speed : float, optional
        So many times faster; else so that it takes 60 s at most.
    camera : str
        Of the model, or ``"azimuth,elevation,distance"`` [deg, deg, m].
    size : (2,)
        Width and height in pixels, even.
    method : str, optional
        Whose estimate grows; else the recording's first that answers.
    joints : str
        Which joint of a foreign table is which axis: ``"yaw=outer,pitch=-middle"``.
    force : bool
        Replace a file that is there.
    progress : callable
        Told the part done, 0 to 1.

    Returns
    -------
    Film
        ``path``, ``pictures``, ``duration`` [s], ``speed``.

    Raises
    ------
    StandError
        No joints; nothing that draws or encodes; an argument is not allowed; a file is there.

    Examples
    --------
    >>> import stand
    >>> stand.film("recordings/sample", "film.avi")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: unknown --out film.avi: kind of film '.avi': ...
    """
    from stand.report.film import write_film

    return write_film(
        _of_file(recording),
        Path(out),
        t_from=t_from_s,
        t_to=t_to_s,
        speed=speed,
        camera=camera,
        size=size,
        method=method,
        joints=joints,
        force=force,
        progress=progress,
    )


def picture(
    recording: Log | Named,
    at_s: float,
    out: Named,
    *,
    camera: str = "review",
    size: tuple[int, int] = (1280, 720),
    method: str | None = None,
    joints: str = "",
    force: bool = False,
) -> Path:
    """One moment of a recording as a PNG; arguments and faults as of `stand.film`.

    Parameters
    ----------
    recording : Recording or path
    at_s : float
        Which moment [s].
    out : path
        A PNG.
    camera, size, method, joints : optional
        As of `stand.film`.
    force : bool
        Replace a file that is there.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    StandError
        A moment beyond the recording; else as `stand.film`.

    Examples
    --------
    >>> import stand
    >>> stand.picture("recordings/sample", 75, "moment.jpg")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: --out moment.jpg: must end in .png
    """
    from stand.report.film import write_picture

    return write_picture(
        _of_file(recording),
        at_s,
        Path(out),
        camera=camera,
        size=size,
        method=method,
        joints=joints,
        force=force,
    )


def _of_file(recording: Log | Named) -> Log:
    from stand.recording.log import Log

    return recording if isinstance(recording, Log) else read(recording)


def recover(place: Named | None = None) -> list[Recovered]:
    """Bring back what interrupted recordings hold, each where it was to be.

    Parameters
    ----------
    place : path, optional
        A folder in which they lie (without it ``recordings``), the target of one, or an MCAP file
        that is cut off.

    Returns
    -------
    list of Recovered
        What became of each: ``found``, ``out``, ``until`` [s], ``files``, ``lost``, ``reason``.

    Raises
    ------
    StandError
        There is no such place.

    Examples
    --------
    >>> import stand
    >>> stand.recover("nowhere")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: nowhere: no such folder, and nothing of an interrupted run of this name
    """
    from stand.recovered import recover as bring_back

    return bring_back(place)


def _path(path: Named) -> Path:
    from stand.errors import StandError

    if not isinstance(path, str | PathLike):
        raise StandError(f"recording = {path!r}: must be a path")
    return Path(path)


def align(
    recordings: Log | Simulated | Named | Sequence[Log | Simulated | Named],
    method: str | None = None,
    *,
    imu: str | ImuSpec | None = None,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    sequences: str | None = None,
    windows_s: Sequence[float] = (),
    calibration: Named | CalibrationRecord | None = None,
) -> Aligned:
    """Estimate the attitude from recordings: several are several dwells of one unit.

    Parameters
    ----------
    recordings : Recording, Simulated, path, or several of them
        Of `stand.read` or `stand.simulate`; a path is read as `stand.read` does.
    method : str, optional
        Id (``stand.catalogue("methods")``); else the recording's own, or triad.
    imu : str or ImuSpec, optional
        Unit whose data sheet's biases and scale errors enter every sigma; else as recorded.
    latitude_deg, height_m : float, optional
        Of the site; else as recorded.
    sequences : str, optional
        By which order of turns a position is read: ``"regular"`` or ``"published"``.
    windows_s : sequence of float, optional
        Lengths of windows [s] into which every stretch is cut too: how their estimates scatter,
        beside the sigma stated.
    calibration : path or of `stand.calibrate`, optional
        Of the unit: taken out of the readings, its sigmas in place of the data sheet's.

    Returns
    -------
    Aligned
        ``estimates``; ``scores`` with errors where the truth is known; ``refusals``; ``windows``.

    Raises
    ------
    StandError
        No method answers, and why; an argument is not allowed.

    Examples
    --------
    >>> import math, stand
    >>> s = stand.settings("two-position", imu="ideal", rate_hz=5, true_table=True)
    >>> run = stand.simulate(s)
    >>> found = stand.align(run, method="triad")
    >>> [(e.label, round(math.degrees(e.heading), 6)) for e in found.estimates]
    [('first', 0.0), ('second', 180.0)]
    >>> stand.align(run, method="traid")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: unknown method 'traid': did you mean triad? known: ...
    """
    from stand.evaluation.aligned import align as align_logs
    from stand.report.notebook import shown
    from stand.results.aligned import Aligned

    several = isinstance(recordings, (list, tuple))
    logs = [_log(one) for one in (recordings if several else [recordings])]
    found = align_logs(
        logs,
        method,
        imu=imu,
        latitude_deg=latitude_deg,
        height_m=height_m,
        sequences=sequences,
        windows_s=windows_s,
        calibration=calibration,
    )
    return shown(Aligned, found)


def calibrate(
    recordings: Log | Simulated | Named | Sequence[Log | Simulated | Named],
    *,
    hand_held: bool = False,
    imu: str | ImuSpec | None = None,
    table: str | Table | None = None,
    trust_table: bool = False,
    free: Sequence[str] = (),
    gravity_m_s2: float | None = None,
    gravity_sigma_m_s2: float | None = None,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    shortest_s: float = 1.0,
    as_published: bool = False,
    axes: str = "",
    serial: str = "",
) -> Calibrated:
    """Find a unit's constant errors, with a sigma of each and what it is made of.

    Parameters
    ----------
    recordings : Recording, Simulated, path, or several of them
    hand_held : bool
        Without a table: a unit that was turned by hand from rest to rest; rests are found. Else
        from the stretches of the recordings, several of which are of one unit on one table.
    imu : str or ImuSpec, optional
        Unit whose data sheet says what is known before. Without it nothing is of a unit by hand;
        on a table what the recording says.
    table : str or Table, optional
        Class of the table; else as recorded.
    trust_table : bool
        Take the table and the unit's seat on it for perfect.
    free : sequence of str
        Terms to find though the data sheet states none: ``"k2"``, ``"asymmetry"`` ...
    gravity_m_s2, gravity_sigma_m_s2 : float, optional
        As measured; else normal gravity of the site, which is good to 30 mGal.
    latitude_deg, height_m : float, optional
        Of the site; else as recorded.
    shortest_s : float
        Of a rest.
    as_published : bool
        The published hand-held method to the letter.
    axes : str
        With which the log was read, for the record.
    serial : str
        Of the unit, for the record.

    Returns
    -------
    Calibrated
        ``calibration``: parameters, covariance, null space, what was left out; ``errors`` where
        the truth is known.

    Raises
    ------
    StandError
        An argument is not allowed; the readings do not tell.

    Examples
    --------
    >>> import stand
    >>> run = stand.simulate(stand.settings("tumble-6", imu="hg9900", rate_hz=20))
    >>> found = stand.calibrate(run)
    >>> gyro = found.calibration.parameters[0]
    >>> gyro.key.term, gyro.basis, bool(gyro.sigma < gyro.prior_sigma)
    ('bias', 'both', True)
    >>> run = stand.simulate(stand.settings("two-position", imu="stim300", rate_hz=20))
    >>> stand.calibrate(run, hand_held=True)
    Traceback (most recent call last):
        ...
    stand.errors.StandError: ...: 2 rests in 600 s: at least 9 are needed, ...
    """
    from stand.arguments import words
    from stand.calibration.by_hand import by_hand
    from stand.calibration.on_table import on_table
    from stand.report.notebook import shown
    from stand.results.calibrated import Calibrated

    several = isinstance(recordings, (list, tuple))
    logs = [_log(one) for one in (recordings if several else [recordings])]
    if not hand_held:
        on = on_table(
            logs,
            imu=imu,
            table=table,
            trust_table=trust_table,
            free=words("free", free),
            gravity=gravity_m_s2,
            gravity_sigma=gravity_sigma_m_s2,
            latitude_deg=latitude_deg,
            height_m=height_m,
            axes=axes,
            serial=serial,
        )
        return shown(Calibrated, on)
    found = by_hand(
        logs,
        imu=imu,
        gravity=gravity_m_s2,
        gravity_sigma=gravity_sigma_m_s2,
        latitude_deg=latitude_deg,
        height_m=height_m,
        shortest_s=shortest_s,
        as_published=as_published,
        axes=axes,
        serial=serial,
    )
    return shown(Calibrated, found)


def apply(
    calibration: Named | CalibrationRecord,
    recording: Named,
    out: Named,
    *,
    form: LogForm | None = None,
    topic: str | None = None,
    temperature_C: float | None = None,
    force: bool = False,
    progress: Progress = _quiet,
) -> Recording:
    """Take a unit's errors out of a log, and write what is left as an MCAP.

    Parameters
    ----------
    calibration : path or of `stand.calibrate`
    recording : path
        A log of any kind, of this unit.
    out : path
        The MCAP to write, with the calibration and the hashes of both in its metadata.
    form : stand.LogForm, optional
        As of `stand.read`.
    topic : str, optional
        Of the IMU, where there are several.
    temperature_C : float, optional
        Of the unit, where the calibration has terms of temperature.
    force : bool
        Replace what is there.
    progress : callable
        Told the part read, 0 to 1.

    Returns
    -------
    Recording
        The corrected log, as `stand.read` gives it.

    Raises
    ------
    StandError
        `out` is there; the log or the calibration is not right, or not of this unit.

    Examples
    --------
    >>> import stand
    >>> stand.apply("none.json", "log.mcap", "corrected.mcap")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: none.json: cannot read this calibration: No such file or directory
    """
    from stand.calibration.corrected import applied

    applied(
        calibration,
        _path(recording),
        _path(out),
        form,
        topic=topic,
        temperature_C=temperature_C,
        force=force,
        progress=progress,
    )
    return read(out)


def _log(recording: object) -> Log:
    from stand.errors import StandError
    from stand.recording.log import Log

    if isinstance(recording, Log):
        return recording
    if isinstance(recording, (str, PathLike)):
        return read(recording)
    from stand.results.simulated import Simulated

    if isinstance(recording, Simulated):
        return recording.log
    raise StandError(
        f"recording: {type(recording).__name__}, must be a path or of stand.read, stand.simulate"
    )


def stretches(
    recording: Log | Simulated | Named, *, shortest_s: float = 3.0, topic: str | None = None
) -> Stretches:
    """Find where a log stands still, or turns evenly about the vertical.

    Parameters
    ----------
    recording : Recording, Simulated or path
    shortest_s : float
        What is shorter is no stretch.
    topic : str, optional
        Of the IMU, where a file has several.

    Returns
    -------
    Stretches
        ``found``: times, means, noise; ``angles``; ``toml()``: the text of a file that
        ``stand.read(..., stretches=...)`` takes, for a person to mend.

    Raises
    ------
    StandError
        An argument is not allowed; the file is not right.

    Examples
    --------
    >>> import stand
    >>> run = stand.simulate(stand.settings("two-position", imu="stim300", rate_hz=20))
    >>> [(s.kind, s.t_from, s.t_to) for s in stand.stretches(run).found if s.kind == "rest"]
    [('rest', 0.0, 295.5), ('rest', 304.0, 600.0)]
    """
    from stand.recording.found_stretches import stretches_of
    from stand.report.notebook import shown
    from stand.results.stretches import Stretches

    named = isinstance(recording, str | PathLike)
    log = read(recording, topic=topic) if named else _log(recording)
    return shown(Stretches, stretches_of(log, shortest_s))


def rehearse(
    settings: Settings,
    *,
    verify: int | None = None,
    keep: Named | None = None,
    scheduler: object = None,
    propose: bool = False,
    progress: Progress = _quiet,
) -> Rehearsed:
    """Before the table is booked: can it run, how long, how accurate, why, what would help.

    Parameters
    ----------
    settings : Settings
        Of `stand.settings`.
    verify : int, optional
        Simulate so many runs and set what they come to beside the predictions.
    keep : path, optional
        File for those runs; those that it holds are not made again.
    scheduler : str or object, optional
        Of a Dask cluster that makes them, as of `stand.campaign`.
    propose : bool
        Look for a shorter test that keeps what is required, too: it is an advice if there is one.
    progress : callable
        Told the part done, 0 to 1: of those runs, without any of the changes that are tried.

    Raises
    ------
    StandError
        An argument is not allowed; a run failed.

    Examples
    --------
    >>> import stand
    >>> answer = stand.rehearse(stand.settings("two-position", imu="hg9900", table="precision"))
    >>> answer.feasible, round(answer.duration.total)
    (True, 600)
    """
    from stand.arguments import MOST_RUNS
    from stand.errors import whole
    from stand.rehearsal.advice import with_advice
    from stand.report.notebook import shown
    from stand.results.rehearsed import Rehearsed

    if verify is not None:
        whole("verify", verify, 1, MOST_RUNS)
    answer = with_advice(_checked(settings), _quiet if verify or propose else progress)
    if propose:
        from stand.proposal.advice import with_proposal

        answer = with_proposal(answer, settings, _quiet if verify else progress)
    if verify is not None:
        from stand.rehearsal.verify import with_verification

        file = None if keep is None else Path(keep)
        engine = _engine(scheduler)
        answer = with_verification(answer, settings, verify, progress, engine=engine, keep=file)
    return shown(Rehearsed, answer)


def compare(
    settings: Settings,
    runs: int = 100,
    *,
    progress: Progress = _quiet,
    workers: int | None = None,
    keep: Named | None = None,
    scheduler: object = None,
) -> Compared:
    """Methods side by side on identical data: error, sigma, floor, NEES, run time.

    Parameters
    ----------
    settings : Settings
        Of the first run, by `stand.settings`; the others differ in their seed. Without
        ``methods`` all that apply are compared.
    runs : int
        Each with a unit, a table and a sway of its own.
    progress : callable
        Told the part done, 0 to 1.
    workers : int, optional
        Processes, which change nothing but the time. A script that lets more than one work must
        keep its own behind ``if __name__ == "__main__"``.
    keep : path, optional
        File for the runs; those that it holds are not made again.
    scheduler : str or object, optional
        Of a Dask cluster that makes them, as of `stand.campaign`.

    Raises
    ------
    StandError
        An argument is not allowed; a setting is impossible.
    RunFailed
        A bug in a run, with its seed.

    Examples
    --------
    >>> import stand
    >>> s = stand.settings("two-position", imu="ring-laser", rate_hz=5, methods=["triad"])
    >>> found = stand.compare(s, runs=4, workers=1)
    >>> [(t.method, t.runs, t.refused) for t in found.tallies]
    [('triad', 4, 0)]
    """
    from stand.arguments import MOST_RUNS, MOST_WORKERS
    from stand.errors import whole
    from stand.evaluation.comparison import compare as compare_methods
    from stand.report.notebook import shown
    from stand.results.compared import Compared

    whole("runs", runs, 1, MOST_RUNS)
    if workers is not None:
        whole("workers", workers, 1, MOST_WORKERS)
    file = None if keep is None else Path(keep)
    found = compare_methods(_checked(settings), runs, progress, workers, _engine(scheduler), file)
    return shown(Compared, found)


def _engine(scheduler: object) -> Engine | None:
    """Who makes runs at a scheduler; None: processes of this machine."""
    if scheduler is None:
        return None
    from stand.simulation.cluster import engine_at

    return engine_at(scheduler)


def campaign(
    sweep: Named,
    out: Named | None = None,
    *,
    resume: bool = False,
    workers: int | None = None,
    scheduler: object = None,
) -> Campaigned:
    """Thousands of runs over any parameter: an iterator, and a table of what it made.

    Parameters
    ----------
    sweep : path
        TOML file: what is run and what is varied in it.
    out : path, optional
        Folder for its results; else one of its own under ``recordings``.
    resume : bool
        Go on with the campaign that is there; nothing that it holds is made again.
    workers : int, optional
        Processes, which change nothing but the time: with one, runs are made in this one. A
        script that lets more than one work must keep its own behind
        ``if __name__ == "__main__"``.
    scheduler : str or object, optional
        Of a Dask cluster: its address, ``"local"`` for one that is started here, or a cluster or
        client of Dask's.

    Returns
    -------
    Campaigned
        Iterate over it: each run as it is made, kept whatever ends the iteration. ``run()`` makes
        all of them; ``columns()`` is the table, ``summary()`` what it says, ``write_page()`` the
        same to look at.

    Raises
    ------
    StandError
        The sweep is not right; the folder is another campaign's, or cannot be written.
    RunFailed
        A bug in a run, with its seed.

    Examples
    --------
    >>> import stand, tempfile, pathlib
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> text = '''title = "Two units"
    ... procedure = "two-position"
    ... rate_hz = 2
    ... runs = 2
    ... [[vary]]
    ... key = "imu"
    ... values = ["hg9900", "ring-laser"]
    ... '''
    >>> _ = (folder / "units.toml").write_text(text)
    >>> made = stand.campaign(folder / "units.toml", folder / "units", workers=1)
    >>> [(run.case, run.seed) for run in made]
    [(1, 0), (1, 1), (2, 0), (2, 1)]
    >>> columns = made.columns()
    >>> sorted({str(q) for q in columns["quantity"][columns["method"] == "triad"]})
    ['NEES', 'heading', 'latitude', 'pitch', 'roll', 'yaw']
    """
    from stand.arguments import MOST_WORKERS
    from stand.campaigns.sweep import load_sweep
    from stand.errors import whole
    from stand.results.campaigned import Campaigned

    if workers is not None:
        whole("workers", workers, 1, MOST_WORKERS)
    engine = None
    if scheduler is not None:
        from stand.simulation.cluster import engine_at

        engine, workers = engine_at(scheduler, workers), None
    folder = None if out is None else Path(out)
    return Campaigned(
        load_sweep(Path(sweep)), folder, resume=resume, engine=engine, workers=workers
    )


def propose(
    requirement: Named | None = None,
    *,
    imu: Named | ImuSpec | None = None,
    table: Named | Table | None = None,
    heading_deg: float | None = None,
    max_time_s: float | None = None,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    rate_hz: int = 200,
    progress: Progress = _quiet,
) -> Proposed:
    """The shortest test that reaches a required accuracy, as a procedure.

    Parameters
    ----------
    requirement : path, optional
        TOML file with ``[require]``, as a procedure has it, and what the test may do
        (``[allowed]``); else `heading_deg`.
    imu, table : str, path, ImuSpec or Table, optional
        Unit and table class; else the file's own, else stim300 on the precision table.
    heading_deg : float, optional
        Required of the heading, by twice its sigma [deg].
    max_time_s : float, optional
        The whole plan may take so long [s]; else as long as it needs.
    latitude_deg, height_m : float, optional
        Of the site; else the file's own.
    rate_hz : int
        Samples per second.
    progress : callable
        Told the part of the work that is done, 0 to 1.

    Returns
    -------
    Proposed
        Its `text` is the procedure; `feasible` whether there is one, else `reason`.

    Raises
    ------
    StandError
        The requirement is not right, or contradicts the table.

    Examples
    --------
    >>> import stand
    >>> found = stand.propose(imu="hg9900", table="precision", heading_deg=0.5, rate_hz=50)
    >>> found.feasible, round(found.total, 1), round(found.bound, 1)
    (True, 9.5, 9.2)
    """
    from stand.proposal.preparation import request
    from stand.proposal.propose import propose as search
    from stand.report.notebook import shown
    from stand.results.proposed import Proposed

    wanted, like = request(
        None if requirement is None else str(requirement),
        imu=imu,
        table=table,
        heading_deg=heading_deg,
        max_time_s=max_time_s,
        latitude_deg=latitude_deg,
        height_m=height_m,
        rate_hz=rate_hz,
    )
    return shown(Proposed, search(wanted, like, progress))


def side_by_side(
    a: Log | Simulated | Named,
    b: Log | Simulated | Named,
    methods: Sequence[str] = (),
    *,
    imu: str | ImuSpec | None = None,
    latitude_deg: float | None = None,
) -> Beside:
    """Two recordings of one procedure beside each other: estimates, means per stretch, noise.

    Parameters
    ----------
    a, b : Recording, Simulated or path
        Their stretches are matched by name; of a log without, name them first
        (``stand.read(path, stretches=...)``).
    methods : sequence of str
        Ids (``stand.catalogue("methods")``); none: those of both.
    imu : str or ImuSpec, optional
        Unit whose data sheet enters the sigmas of both; else as recorded.
    latitude_deg : float, optional
        Of both; else as recorded.

    Raises
    ------
    StandError
        Stretches that cannot be matched; an argument is not allowed.

    Examples
    --------
    >>> import stand
    >>> s = stand.settings("two-position", imu="ring-laser", rate_hz=5, seed=1)
    >>> other = stand.settings("two-position", imu="ring-laser", rate_hz=5, seed=2)
    >>> found = stand.side_by_side(stand.simulate(s), stand.simulate(other), ["two-position"])
    >>> [(e.a.label, bool(abs(e.off[2]) < 4 * e.sigmas[2])) for e in found.estimates]
    [('first', True)]
    """
    from stand.arguments import words
    from stand.evaluation.side_by_side import side_by_side as beside
    from stand.report.notebook import shown
    from stand.results.beside import Beside

    logs = _log(a), _log(b)
    named = words("methods", methods)
    return shown(Beside, beside(*logs, named, imu=imu, latitude_deg=latitude_deg))


def allan(
    recording: Log | Simulated | Named,
    *,
    imu: str | None = None,
    terms: Sequence[str] = (),
    topic: str | None = None,
    t_from_s: float | None = None,
    t_to_s: float | None = None,
    form: LogForm | None = None,
    progress: Progress = _quiet,
) -> Analysed:
    """Allan analysis of a unit at rest: noise terms with intervals, against its data sheet.

    Parameters
    ----------
    recording : Recording, Simulated or path
    imu : str, optional
        Data sheet to compare with; else the recording's own.
    terms : sequence of str
        Refuse unless the record shows these, of N, B, K, Q, R.
    topic : str, optional
        Of the IMU, where a file has several.
    t_from_s, t_to_s : float, optional
        The stretch to use; else the longest rest, or all.
    form : stand.LogForm, optional
        As for `stand.read`.
    progress : callable
        Told the part read, 0 to 1.

    Raises
    ------
    StandError
        An argument is not allowed; the file is not right.
    AlignmentError
        Not at rest, or too short.

    Examples
    --------
    >>> import stand
    >>> run = stand.simulate(stand.settings("two-position", imu="stim300", rate_hz=20))
    >>> found = stand.allan(run)
    >>> found.sheet_title
    'Safran STIM300, 10 g accelerometers (stim300)'
    """
    from stand.arguments import ALLAN_TERMS, words
    from stand.errors import unknown
    from stand.evaluation.allan import analyse
    from stand.report.notebook import shown
    from stand.results.analysed import Analysed

    asked = [term.upper() for term in words("terms", terms)]
    for term in asked:
        if term not in ALLAN_TERMS:
            raise unknown("term", term, ALLAN_TERMS)
    if isinstance(recording, str | PathLike):
        from stand.recording.entrance import read_imu

        source = read_imu(_path(recording), topic, form, progress)
    else:
        source = _log(recording).imu
    return shown(Analysed, analyse(source, topic, t_from_s, t_to_s, imu, asked))


def catalogue(what: str) -> Entries:
    """What can be run, simulated and estimated.

    Parameters
    ----------
    what : str
        ``"procedures"``, ``"imus"``, ``"tables"``, ``"trajectories"`` or ``"methods"``.

    Returns
    -------
    Entries
        A tuple of dictionaries that prints as a table.

    Raises
    ------
    StandError
        There is no such catalogue.

    Examples
    --------
    >>> import stand
    >>> [entry["title"] for entry in stand.catalogue("imus") if entry["id"] == "stim300"]
    ['Safran STIM300, 10 g accelerometers']
    """
    from stand.report.listing import listing
    from stand.results.entries import Entries

    return Entries(listing(what))


def unit(
    imu: Named | ImuSpec,
    *,
    rate_hz: int,
    seed: int = 0,
    without: Sequence[str] = (),
    sampling: str = "mean",
    **mistaken: Never,
) -> Unit:
    """The sensor model alone, for anybody's simulator.

    Parameters
    ----------
    imu : str, path or ImuSpec
        Id (``stand.catalogue("imus")``) or a TOML file.
    rate_hz : int
        Samples per second.
    seed : int
        Same seed, same unit and the same noise.
    without : sequence of str
        Error terms to switch off.
    sampling : str
        What the truth is given as, and the unit reports: ``"mean"`` over each interval, or the
        ``"instant"`` at its end.

    Returns
    -------
    Unit
        ``report(t, w_ib_b, f_b)`` gives readings of the truth, block after block, the same for
        any blocks; ``state()`` and ``from_state`` save and resume it.

    Raises
    ------
    StandError
        An argument is not allowed.

    Examples
    --------
    >>> import numpy as np, stand
    >>> unit = stand.unit("stim300", rate_hz=200, seed=1)
    >>> t = np.arange(1, 401) / 200
    >>> w, f = np.zeros((400, 3)), np.tile([0.0, 9.81, 0.0], (400, 1))
    >>> a = unit.report(t[:100], w[:100], f[:100])
    >>> saved = unit.state()
    >>> b = unit.report(t[100:], w[100:], f[100:])
    >>> resumed = type(unit).from_state(saved)
    >>> bool((resumed.report(t[100:], w[100:], f[100:]).w_ib_b == b.w_ib_b).all())
    True
    >>> unit.report(t, w, f)
    Traceback (most recent call last):
        ...
    stand.errors.StandError: t: sample 0 at 0.005 s, must be at 2.005 s: each sample of 200 Hz ...
    """
    from os import fspath

    from stand.arguments import one_of, refuse_mistaken, words
    from stand.imu import ImuSpec, load_imu
    from stand.imu.unit import Unit
    from stand.samples import Sampling

    refuse_mistaken(mistaken, unit)
    spec = imu if isinstance(imu, ImuSpec) else load_imu(fspath(imu))
    kind = one_of("sampling", sampling, Sampling)
    return Unit(spec, rate_hz, seed, words("without", without), kind)
