"""The wheel is built, installed in a clean environment and used outside the checkout."""

import os
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from test_layers import OURS, ROOT, graph

# import name: distribution name, where they differ
DISTRIBUTIONS = {"rerun": "rerun-sdk", "annotated_types": "annotated-types"}


def test_every_import_is_a_declared_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    used_extras = ("logs", "campaign", "cluster", "film")
    wanted = [*project["dependencies"], *(d for e in used_extras for d in extras[e])]
    declared = {d.split(">")[0].split("=")[0].strip() for d in wanted}
    used = {t.split(".")[0] for found in graph(ROOT).values() for t in found}
    outside = used - set(sys.stdlib_module_names) - set(OURS)
    assert {DISTRIBUTIONS.get(name, name) for name in outside} - {"pydantic_core"} <= declared
    # and each declared one is used
    assert declared <= {DISTRIBUTIONS.get(name, name) for name in outside}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    out = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, ROOT],
        check=True,
        capture_output=True,
    )
    (path,) = out.glob("*.whl")
    return path


def test_the_wheel_ships_every_model_and_catalogue_entry(wheel):
    inside = set(zipfile.ZipFile(wheel).namelist())
    for kind in ("*.toml", "*.py", "py.typed"):
        for path in [p for package in OURS for p in (ROOT / package).rglob(kind)]:
            assert str(path.relative_to(ROOT)) in inside
    models = {f"stand/{path.relative_to(ROOT)}" for path in (ROOT / "models").rglob("*.xml")}
    assert models == {name for name in inside if name.endswith(".xml")} != set()
    tops = {name.partition("/")[0] for name in inside}
    assert {name for name in tops if not name.endswith(".dist-info")} == set(OURS)


WHERE = """
import stand, alignment
from stand.physics.mjcf import load_model, models_folder
assert load_model().nu == 6
print(stand.__file__, alignment.__file__, models_folder())
"""


@pytest.mark.slow
def test_an_editable_install_finds_the_models_of_the_checkout(tmp_path):
    """As `pip install -e .` makes it; the build backend and dependencies are lent."""
    home = tmp_path / "env"
    venv.create(home, with_pip=False)
    (site,) = home.glob("lib/python*/site-packages")
    (site / "lent.pth").write_text(sysconfig.get_path("purelib"))
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet"]
    options = ["--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    # lent packages count as installed: those of this environment must not be looked for
    subprocess.run(
        [*pip, *options, "--ignore-installed", "--editable", ROOT], check=True, cwd=tmp_path
    )
    where = subprocess.run(
        [python, "-c", WHERE], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout.split()
    assert [Path(p) for p in where] == [
        ROOT / "stand" / "__init__.py", ROOT / "alignment" / "__init__.py", ROOT / "models"
    ]  # fmt: skip


@pytest.mark.slow
def test_an_installed_wheel_runs_outside_the_checkout(wheel, tmp_path):
    """The dependencies are lent by this environment; our packages come from the wheel alone."""
    home = tmp_path / "env"
    venv.create(home, with_pip=False)
    (site,) = home.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    (site / "lent.pth").write_text(sysconfig.get_path("purelib"))
    python = home / "bin" / "python"

    def stand(*arguments):
        code = "from stand.cli.app import main; main()"
        done = subprocess.run(
            [python, "-c", code, *arguments],
            cwd=tmp_path,
            env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = subprocess.run(
        [python, "-c", WHERE], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert all(Path(p).is_relative_to(home) for p in where.split())
    assert "stim300" in stand("list", "imus")
    stand("run", "six-position", "--rate", "2")
    assert (tmp_path / "recordings" / "six-position_stim300_seed0" / "run.rrd").exists()
    assert '"six-position"' in stand("align", "recordings/six-position_stim300_seed0", "--json")
