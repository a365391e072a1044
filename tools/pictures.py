"""Every picture of docs/ and the commands that make it: in a folder of its own, then put in place.

    python tools/pictures.py                  # lists them
    python tools/pictures.py stand.png ...    # makes these anew, or `all`

Files that a page of docs/ names stand in the folder, and the sample recording. Pictures of the
review need a Vulkan driver, those of pages a Chromium (see .ci/run).
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
_REVIEW = "python tools/review_picture.py"
_EDGES = "stand run tumble-12 --imu stim300 --rate 20 --seed 3 --out tumble"
_BY_HAND = "stand calibrate tumble --hand-held --imu stim300 --gravity-sigma 1e-6"

COMMANDS: dict[str, tuple[str, ...]] = {
    "allan.png": (
        "stand run static --imu stim300 --out rest",
        "stand allan rest --imu stim300 --out page",
        "cp page/allan.png allan.png",
    ),
    "calibration.png": (
        _EDGES,
        f"{_BY_HAND} --report certificate",
        "cp certificate/before-after.png calibration.png",
    ),
    "compare.png": (
        "stand compare two-position --imu ring-laser --runs 1 --out page",
        "cp page/compare.png compare.png",
    ),
    "film.webp": (
        "stand film recordings/sample --speed 32 --size 640x360 --out film.webp",
    ),
    "rehearsal.png": (
        "stand rehearse north.toml --imu ring-laser --report north   # exit code 1",
        "screenshot north/rehearsal.html 1200x1400 rehearsal.png",
    ),
    "review.png": (
        "stand run six-position --out six",
        f"{_REVIEW} six/run.rrd review.png 60 --size 1600x900",
    ),
    "rocking.png": (
        "stand run carousel-on-a-swaying-base.toml --imu ring-laser --motion servo --out rocking",
        f"{_REVIEW} rocking/run.rrd rocking.png 100 --size 1600x900",
    ),
    "speed.png": ("make peers",),
    "stand.png": ("python tools/stand_picture.py stand.png outer=30 middle=20 --size 900 675",),
    "trade-off.png": (
        "stand propose own-unit.toml --rate 50 --trade-off --report best",
        "cp best/trade-off.png trade-off.png",
    ),
    "verified.png": (
        "stand rehearse north.toml --imu ring-laser --verify 500 --report north   # exit code 1",
        "screenshot north/rehearsal.html#verified 1200x640 verified.png",
    ),
}  # fmt: skip


def make(name: str) -> Path:
    """Make a picture anew and put it into docs/."""
    with TemporaryDirectory() as folder:
        _furnish(Path(folder))
        for line in COMMANDS[name]:
            print(line, file=sys.stderr)
            command, _, comment = line.partition("#") if "   #" in line else (line, "", "")
            _do(shlex.split(command), Path(folder), int("exit code 1" in comment))
        made = Path(folder) / name
        if made.exists():  # `make peers` writes into docs/ by itself
            if made.suffix == ".png":
                _make_small(made)
            shutil.copyfile(made, DOCS / name)
    return DOCS / name


def _make_small(picture: Path) -> None:
    """256 colours, which are enough for these: a third of the bytes."""
    with Image.open(picture) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


def _furnish(folder: Path) -> None:
    """The files that the pages show, under the names that the text before them gives."""
    shutil.copytree(ROOT / "recordings" / "sample", folder / "recordings" / "sample")
    for page in DOCS.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        for block in re.finditer(r"^```toml\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
            names = re.findall(r"`([\w-]+\.toml)`", text[: block.start()])
            (folder / names[-1]).write_text(block[1], encoding="utf-8")


def _do(words: list[str], folder: Path, code: int) -> None:
    program, *rest = words
    if program == "screenshot":
        _screenshot(folder, *rest)
        return
    if program == "cp":
        shutil.copyfile(folder / rest[0], folder / rest[1])
        return
    if program == "python":
        command, at = [sys.executable, str(ROOT / rest[0]), *rest[1:]], folder
    elif program == "make":
        command, at = words, ROOT
    else:
        command, at = [str(Path(sys.executable).with_name(program)), *rest], folder
    done = subprocess.run(command, cwd=at, check=False, stdout=subprocess.DEVNULL)
    if done.returncode != code:
        sys.exit(f"{' '.join(words)}: exit code {done.returncode}, must be {code}")


def _screenshot(folder: Path, page: str, size: str, out: str) -> None:
    """A page as a browser without a screen shows it; from an anchor on where it has one."""
    sys.path.insert(0, str(ROOT / "tools" / "site"))
    from look import opened  # pyright: ignore[reportMissingImports]

    path, _, anchor = page.partition("#")
    url = (folder / path).as_uri() + (f"#{anchor}" if anchor else "")
    opened(
        url, f"--screenshot={folder / out}", f"--window-size={size.replace('x', ',')}",
        "--blink-settings=preferredColorScheme=1", "--force-device-scale-factor=1",
    )  # fmt: skip


def _main() -> None:
    chosen = sys.argv[1:]
    if not chosen:
        for name, lines in COMMANDS.items():
            print(f"{name}:", *lines, sep="\n    ")
    for name in COMMANDS if chosen == ["all"] else chosen:
        if name not in COMMANDS:
            sys.exit(f"unknown picture {name!r}: known: {', '.join(COMMANDS)}")
        print(make(name))


if __name__ == "__main__":
    _main()
