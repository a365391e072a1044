"""Pictures of a recording as the rerun viewer shows it, without a screen.

    python tools/review_picture.py FILE.rrd OUT.png SECONDS...

Writes OUT.png, or OUT_<seconds>.png where several times are given; prints what each view of the
viewer reports, and ends with 1 if any view reports anything: a review must open without a fault.
"""

import argparse
import hashlib
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import numpy as np
from rerun.experimental import ViewerClient, ViewerState

from stand.errors import StandError
from stand.folder import write_file
from stand.recording.viewer import LOOPBACK, checked_recording, quiet_environment, viewer_binary

TIMELINE = "sim_time"
START_LIMIT_S = 20.0
SETTLE_LIMIT_S = 60.0
NO_DRIVER = (
    "the headless viewer found no Vulkan driver; without a graphics card: "
    "apt install mesa-vulkan-drivers libvulkan1"
)


def pictures(
    recording: Path, out: Path, seconds: Sequence[float], size: str = "1920x1080"
) -> tuple[list[Path], ViewerState]:
    """Take one picture of a recording per time.

    Parameters
    ----------
    recording : path
        An .rrd or .mcap.
    out : path
        Of the PNG; for several times the time is added to its name.
    seconds : sequence of float
        Times since the start of the run.
    size : str
        Of the picture, in pixels.

    Returns
    -------
    list of Path
        The pictures.
    ViewerState
        ``views[i].reports`` are the faults of each view.

    Raises
    ------
    StandError
        No such recording, no viewer or no Vulkan driver.
    """
    source = checked_recording(recording)
    names = [out if len(seconds) == 1 else out.with_stem(f"{out.stem}_{s:g}") for s in seconds]
    with headless_viewer(size) as viewer:
        viewer.open(str(source.resolve()))
        _loaded(viewer)
        for name, second in zip(names, seconds, strict=True):
            moment = np.timedelta64(round(second * 1e9), "ns")
            viewer.set_time(TIMELINE, duration=moment, play_state="paused")
            write_file(name, _settled(viewer))
        _show_all_tabs(viewer)
        return names, viewer.get_state()


@contextmanager
def headless_viewer(size: str = "1920x1080") -> Iterator[ViewerClient]:
    """A viewer without a window, on a free port of this machine only; always ended."""
    port = _free_port()
    options = ["--headless", "--hide-welcome-screen", "--bind", LOOPBACK, "--port", str(port)]
    command = [viewer_binary(), *options, "--window-size", size]
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            command, env=quiet_environment(), stdout=log, stderr=subprocess.STDOUT
        )
        try:
            _wait_for_port(process, port, log)
            yield ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
        finally:
            _end(process)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def _wait_for_port(process: subprocess.Popen[bytes], port: int, log: IO[bytes]) -> None:
    deadline = time.monotonic() + START_LIMIT_S
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise StandError(_failure(log))
        with suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1.0):
            return
        time.sleep(0.05)
    raise StandError(f"the viewer did not answer within {START_LIMIT_S:g} s: {_failure(log)}")


def _failure(log: IO[bytes]) -> str:
    log.seek(0)
    text = log.read().decode(errors="replace")
    if "adapter" in text.lower():
        return NO_DRIVER
    return next((line for line in reversed(text.splitlines()) if line.strip()), "no message")


def _end(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _loaded(viewer: ViewerClient) -> None:
    """Wait until the viewer has read the whole file."""
    deadline = time.monotonic() + SETTLE_LIMIT_S
    while viewer.get_state().loading:
        if time.monotonic() > deadline:
            raise StandError(f"the recording was not read within {SETTLE_LIMIT_S:g} s")
        time.sleep(0.1)


def _show_all_tabs(viewer: ViewerClient) -> None:
    """Turn through the tabs: a view reports nothing before it was shown."""
    recording = viewer.get_state().active_recording
    layout = viewer.get_blueprint().blueprint
    boxes = [entry.get("ContainerBlueprint", {}) for entry in layout.values()]
    tabs = [box for box in boxes if box.get("container_kind") == "Tabs"]
    for k in range(1, max((len(box["contents"]) for box in tabs), default=0)):
        for box in tabs:
            box["active_tab"] = box["contents"][min(k, len(box["contents"]) - 1)]
        viewer.set_blueprint(layout, store_id=recording)
        _settled(viewer, same=2)


def _settled(viewer: ViewerClient, gap_s: float = 0.3, same: int = 3) -> bytes:
    """A screenshot: taken until `same` in a row are equal, since the first come early."""
    last, run = b"", 0
    deadline = time.monotonic() + SETTLE_LIMIT_S
    while time.monotonic() < deadline:
        png = viewer.take_screenshot()
        digest = hashlib.sha256(png).digest()
        run = run + 1 if digest == last else 1
        last = digest
        if run == same:
            return png
        time.sleep(gap_s)
    raise StandError(f"the view did not settle within {SETTLE_LIMIT_S:g} s")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command: 0 if no view reports a fault, 1 if one does, 2 if there is no picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("seconds", type=float, nargs="*", default=[0.0])
    parser.add_argument("--size", default="1920x1080")
    options = parser.parse_args(arguments)
    try:
        names, state = pictures(options.recording, options.out, options.seconds, options.size)
    except StandError as error:
        print(error, file=sys.stderr)
        return 2
    reports = [(view.name, report) for view in state.views for report in view.reports]
    print(f"{len(state.views)} views, {len(reports)} reports; {', '.join(map(str, names))}")
    for name, report in reports:
        print(f"{report.severity} in {name!r}: {report.summary} {report.details or ''}")
    return 1 if reports else 0


if __name__ == "__main__":
    sys.exit(main())
