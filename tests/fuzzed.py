"""Damaged logs: each is read, or refused in one line; no traceback, no hang, little memory."""

import contextlib
import resource
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import fuzzed_texts
import numpy as np
from written_logs import at_rest, mcap, ros1_bag, stamps

import stand
from alignment.errors import Fault
from stand.recording.log_form import LogForm

N = 60  # rows of what is damaged
SECONDS = 10  # of computing that a case may take; thousands take one
MEMORY = 1 << 30  # bytes more than were held before
CLEAR_REFS, STATUS = (Path("/proc/self") / name for name in ("clear_refs", "status"))
HEAD = "t,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
CLEAR = LogForm()
FORM = LogForm(columns="t,gx,gy,gz,ax,ay,az", gyro_unit="rad/s", accel_unit="m/s^2")


def whole(folder: Path) -> dict[str, list[tuple[bytes, LogForm]]]:
    """By kind, small logs that are right, and how they are to be read."""
    from rosbags.rosbag1 import Writer
    from scipy.io import savemat

    w, f = at_rest(N)
    t_ns, rows = stamps(N), np.c_[np.arange(1, N + 1) / 100, w, f]
    path = folder / "whole"
    found: dict[str, list[tuple[bytes, LogForm]]] = {
        kind: [] for kind in ("text", "MCAP", "bag", "npy", "npz", "mat")
    }

    def keep(kind: str, form: LogForm = CLEAR) -> None:
        found[kind].append((path.read_bytes(), form))
        path.unlink()

    for separator in (",", "\t", "; "):
        np.savetxt(path, rows, "%.9g", separator, header=HEAD.replace(",", separator), comments="")
        keep("text")
    for ros1, bare in ((False, False), (True, False), (False, True), (True, True)):
        mcap(path, t_ns, w, f, ros1=ros1, bare=bare)
        keep("MCAP")
    for compression in (None, *Writer.CompressionFormat):
        ros1_bag(path, t_ns, w, f, compression=compression)
        keep("bag")
    for array in (rows, np.rec.fromarrays(rows.T, names=HEAD), rows.T.astype(">f4")):
        with path.open("wb") as file:
            np.save(file, array)
        keep("npy", LogForm() if array.dtype.names else FORM)
    for save in (np.savez, np.savez_compressed):
        with path.open("wb") as file:
            save(file, t=rows[:, 0], gyro_rad_s=w, acc_m_s2=f.T)
        keep("npz")
    for compressed in (False, True):
        for variables, form in (
            ({"t": rows[:, 0], "gyro_rad_s": w, "acc_m_s2": f}, LogForm()),
            ({"imu": {"t": rows[:, 0], "gyro_rad_s": w, "acc_m_s2": f, "n": "x"}}, LogForm()),
            ({"data": rows.astype("f4"), "cell": np.array([1, "a"], object)}, FORM),
        ):
            with path.open("wb") as file:
                savemat(file, variables, do_compression=compressed)
            keep("mat", form)
    return found


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes and bits changed, parts cut out, doubled, filled, or the end missing."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        # half of all damage lies in the first bytes, where lengths and counts are
        most = len(out) if rng.random() < 0.5 else min(len(out), 400)
        at = int(rng.integers(0, max(most, 1)))
        size = int(rng.integers(1, 40))
        match int(rng.integers(0, 8)):
            case 0 | 1:
                out[at : at + 1] = bytes([int(rng.integers(0, 256))])
            case 2:
                out[at : at + 1] = bytes([out[at] ^ 1 << int(rng.integers(0, 8))] if out else b"")
            case 3:
                out[at : at + 4] = int(rng.choice([0, 1, 2**31, 2**32 - 1, 2**24])).to_bytes(
                    4, "little"
                )
            case 4:
                del out[at : at + size]
            case 5:
                out[at:at] = out[at : at + size]
            case 6:
                out[at : at + size] = rng.bytes(size)
            case 7 if rng.random() < 0.3:
                del out[at:]
    return bytes(out)


class _Hang(Exception):
    """A case that took too long."""


def _alarm(signum: int, frame: object) -> None:
    raise _Hang


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """A hang becomes an error."""
    before = signal.signal(signal.SIGPROF, _alarm)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def outcome(path: Path, form: LogForm, aligned: bool) -> str:
    """read or refused; anything else is raised."""

    def read(path: Path) -> None:
        log = stand.read(path, form=form)
        if aligned:
            stand.align(log)

    return outcome_of(read, path)


def outcome_of(read: Callable[[Path], object], path: Path) -> str:
    """The same of what is read in any way."""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        read(path)
    except Fault as error:
        if "\n" in str(error) or len(str(error)) > 1000:
            raise AssertionError(f"not one line: {error!s:.2000}") from error
        return "refused"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return "read"


def run(
    kind: str,
    cases: int,
    folder: Path,
    seed: int = 0,
    first: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Counter[str]:
    """So many damaged logs of a kind; the first that is neither read nor refused is raised."""
    found: Counter[str] = Counter()
    begin = _peak(anew=True)  # other tests of this process have had theirs
    path = folder / f"damaged.{'toml' if kind in fuzzed_texts.KINDS else kind}"
    logs = [] if kind in fuzzed_texts.KINDS else whole(folder)[kind]
    texts = [] if logs else fuzzed_texts.seeds()[kind]
    for data, form in logs:
        path.write_bytes(data)
        stand.align(stand.read(path, form=form))  # whole ones are read
    for data, read in texts:
        path.write_bytes(data)
        read(path)
    with limited():
        for k in range(first, first + cases):
            rng = np.random.default_rng([seed, k])
            try:
                if logs:
                    data, form = logs[k % len(logs)]
                    path.write_bytes(damaged(data, rng))
                    found[outcome(path, form, aligned=k % 16 == 0)] += 1
                else:
                    data, read = texts[k % len(texts)]
                    harm = damaged if rng.random() < 0.5 else fuzzed_texts.altered
                    harm = fuzzed_texts.altered_record if kind == "metadata" else harm
                    path.write_bytes(harm(data, rng))
                    found[outcome_of(read, path)] += 1
            except (Exception, _Hang) as error:
                kept = path.rename(folder / f"failed.{kind}")
                told = repr(error)[:500]
                raise AssertionError(f"{kind}, seed {seed}, case {k}: {kept}: {told}") from error
            progress(k - first)
    more = _peak() - begin
    assert more < MEMORY, f"{kind}: {more / 1e6:.0f} MB"
    return found


def _peak(*, anew: bool = False) -> int:
    """The most memory this process has held [bytes]: ever, or where Linux tells it since `anew`."""
    if anew:
        with contextlib.suppress(OSError):  # not every system has it
            CLEAR_REFS.write_text("5", "ascii")  # the peak begins again at what is held now
    if not STATUS.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    (line,) = [x for x in STATUS.read_text("ascii").splitlines() if x.startswith("VmHWM")]
    return int(line.split()[1]) * 1024
