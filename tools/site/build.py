"""Build the site: make docs.

    python tools/site/build.py           # build/docs/html/index.html

The sources of docs/ are laid together with what the code writes of itself (catalogues, commands,
faults, drawings), and Sphinx makes pages of them; notebooks run in the build. Warnings are errors.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from catalogue_pages import KINDS, Pages, catalogue_pages, command_pages, python_pages, toctree
from drawings import write_drawings, write_procedures
from faults import fault_page

from stand.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
DOCS, SITE = ROOT / "docs", ROOT / "docs" / "site"
BUILD = ROOT / "build" / "docs"
SOURCE, HTML = BUILD / "source", BUILD / "html"

# Commands in notebooks speak to a file, not to a screen of many colours; the kernel is ours alone.
IPYTHON = BUILD / "ipython"
PLAIN = {
    "profile_default/startup/plain.py": "import os\n"
    "for name in ('FORCE_COLOR', 'CLICOLOR', 'CLICOLOR_FORCE'):\n    os.environ.pop(name, None)\n",
    "profile_default/ipython_kernel_config.py": "c.IPKernelApp.log_level = 40\n",
}

# Pages of docs/ in the order in which they are read; one that is not here comes with the guides.
START = ("readme", "running")
EXPLAINED = ("notation", "methods", "papers", "proof", "proof-allan", "speed", "mutants")
CHANGED = ("changelog",)


def assemble() -> None:
    """Lay the sources together."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    shutil.copytree(SITE, SOURCE, ignore=shutil.ignore_patterns("methods.toml", "faults.json"))
    for file in DOCS.iterdir():
        if file.is_file():
            shutil.copy(file, SOURCE)
    shutil.copy(ROOT / "CITATION.cff", SOURCE)
    # notebooks run where they lie, and find there what a reader finds in a checkout
    shutil.copytree(ROOT / "recordings" / "sample", SOURCE / "tutorials" / "recordings" / "sample")
    for name in _too_early():
        (SOURCE / "tutorials" / f"{name}.md").unlink()
    for path, text in _written().items():
        target = SOURCE / f"{path}.md"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    write_drawings(SOURCE)
    write_procedures(SOURCE)
    index = SOURCE / "index.md"
    index.write_text(
        index.read_text(encoding="utf-8") + toctree(list(SECTIONS), hidden=True), encoding="utf-8"
    )


def _too_early() -> list[str]:
    """Tutorials on a command that is not there yet: `needs: COMMAND` in their head says so."""
    found = []
    for path in (SITE / "tutorials").glob("*.md"):
        needed = re.search(r"^needs: (\S+)$", path.read_text(encoding="utf-8"), re.M)
        if needed is not None and needed[1] not in COMMANDS:
            found.append(path.stem)
    return found


def _written() -> Pages:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    readme = readme.replace("](docs/", "](").replace("](CHANGELOG.md)", "](changelog.md)")
    readme = readme.replace("# imu-test-stand", "# A tour", 1)
    return {
        "readme": readme,
        "changelog": _changelog(),
        "faults": fault_page(),
        **catalogue_pages(),
        **command_pages(),
        **python_pages(),
        **_sections(),
    }


def _changelog() -> str:
    """The changelog, whose words in brackets are no links."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return re.sub(r"\[(?=[^\]]*\](?!\())", r"\\[", text)


SECTIONS = {  # of the site, each a page that leads to its own
    "start": ("Start", "What there is, and a first run."),
    "tutorials/index": ("Tutorials", "Notebooks that the build has run: each asks one question, "
                        "and ends with a picture of the answer."),
    "guides": ("Guides", "One job each, from the beginning to the end."),
    "explanations/index": ("Explanations", "Why the numbers are what they are, and what they do "
                           "not hold."),
    "catalogues": ("Catalogues", "What comes with it; each entry is one file or one module."),
    "reference/index": ("Reference", "Every command, every function, every message."),
}  # fmt: skip


def _sections() -> Pages:
    """A page for each section, and the contents of the site."""
    own = {p.stem for p in DOCS.glob("*.md")}
    explained = [name for name in EXPLAINED if name in own]
    explained += sorted(name for name in own if name.startswith("proof") and name not in explained)
    guides = sorted(own - {*explained, *START, *CHANGED})
    inner = {
        "start": START,
        "tutorials/index": sorted(p.stem for p in (SOURCE / "tutorials").glob("*.md")),
        "guides": guides,
        "explanations/index": [
            *sorted(p.stem for p in (SITE / "explanations").glob("*.md")),
            *(f"../{name}" for name in explained),
        ],
        "catalogues": [f"catalogue/{what}" for what in KINDS],
        "reference/index": ["../commands", "stand", "results", "alignment", "../faults",
                            *(f"../{name}" for name in CHANGED)],
    }  # fmt: skip
    return {
        page: f"# {title}\n\n{text}\n\n{toctree(inner[page])}"
        for page, (title, text) in SECTIONS.items()
    }


def build() -> int:
    """Run Sphinx; its exit code."""
    shutil.rmtree(HTML, ignore_errors=True)
    shutil.rmtree(IPYTHON, ignore_errors=True)
    for name, text in PLAIN.items():
        (IPYTHON / name).parent.mkdir(parents=True, exist_ok=True)
        (IPYTHON / name).write_text(text, encoding="utf-8")
    environment = os.environ | {
        "IPYTHONDIR": str(IPYTHON),
        "OMP_NUM_THREADS": "1",
        "COLUMNS": "112",
        "TTY_COMPATIBLE": "0",
        "PYTHONPATH": str(ROOT),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }
    command = [
        sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet",
        "--jobs", "2", "-d", BUILD / "doctrees", SOURCE, HTML, *sys.argv[1:],
    ]  # fmt: skip
    return subprocess.run(command, cwd=BUILD, env=environment, check=False).returncode


def _main() -> int:
    begun = time.monotonic()
    assemble()
    print(f"sources: {time.monotonic() - begun:.0f} s", file=sys.stderr)
    code = build()
    print(f"{HTML / 'index.html'}: {time.monotonic() - begun:.0f} s", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(_main())
