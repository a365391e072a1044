"""The site's own pages: one for each entry, and none that says what is no longer so."""

import json
import re
import sys
from pathlib import Path

import pytest
from test_layers import STOREYS

import stand
from alignment import ESTIMATORS
from stand import toml_files
from stand.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
SITE = ROOT / "tools" / "site"


@pytest.fixture(scope="module")
def site():
    """The modules that write pages, which are scripts beside one another."""
    sys.path.insert(0, str(SITE))
    try:
        import catalogue_pages
        import faults

        yield catalogue_pages, faults
    finally:
        sys.path.remove(str(SITE))


def test_every_entry_has_its_page(site):
    pages = site[0].catalogue_pages()
    for what in ("imus", "tables", "procedures", "trajectories"):
        assert {f"catalogue/{what}/{name}" for name in toml_files.ids(what)} <= pages.keys()
    assert {f"catalogue/methods/{name}" for name in ESTIMATORS} <= pages.keys()
    page = pages["catalogue/imus/stim300"]
    assert "| `angle_random_walk_deg_rt_h` | 0.15 | typical | Safran TS1524" in page
    unstated = pages["catalogue/imus/hg9900"].partition("leaves out")[2]
    assert "states no g-sensitivity of the gyros" in unstated


def test_every_method_says_its_formula_what_it_assumes_and_its_proof(site):
    """A new method owes an entry in docs/site/methods.toml; all else is read from its code."""
    pages = site[0].catalogue_pages()
    for name in ESTIMATORS:
        page = pages[f"catalogue/methods/{name}"]
        assert site[0].NO_FORMULA not in page, name
        assert "What it assumes\n\n\n" not in page, name
        assert "Leading errors" in page, name
    rows = pages["catalogue/methods/triad"].partition("How its predictions stand")[2]
    assert "| random-sway |" not in rows  # those of docs/proof.md on this method alone
    assert rows.count("| triad |") > 20


def test_every_function_and_answer_of_the_python_face_is_described(site):
    pages = site[0].python_pages()
    for name in stand.__all__:
        assert name == "__version__" or f":: stand.{name}\n" in pages["reference/stand"] + "\n"
    for answer in ("simulated.Simulated", "rehearsed.Rehearsed", "calibrated.Calibrated"):
        assert f".. autoclass:: stand.results.{answer}\n" in pages["reference/results"]


def test_every_command_has_its_page_with_every_option(site):
    pages = site[0].command_pages()
    assert {f"commands/{name}" for name in COMMANDS} <= pages.keys()
    film = pages["commands/film"]
    for option in ("--from S", "--speed X", "--camera NAME\\|A,E,D", "--force"):
        assert option in film
    assert "```sh\nstand film recordings/sample --from 60 --to 70 --out turn.mp4\n```" in film


def test_every_example_of_a_fault_fits_a_message_of_the_source(site):
    """Where the source's message changed: python tools/site/faults.py."""
    index = site[1]
    known = index.faults()
    assert len(known) > 300
    seen = json.loads(index.EXAMPLES.read_text(encoding="utf-8"))
    stale = [
        message
        for file, messages in seen.items()
        for message in messages
        if not any(fault.file == file and fault.fits(message) for fault in known)
    ]
    # the page leaves out what fits no more; much of it would be a sign that nobody made it anew
    assert len(stale) <= 0.2 * sum(map(len, seen.values())), stale
    assert not re.search(r"/(tmp|home|root|work)/", json.dumps(seen))
    assert "`… …: exists; --force replaces it`" in index.fault_page()


@pytest.mark.parametrize(
    ("source", "template", "remedy"),
    [
        ("raise StandError(f'{a}: must be 1 to {b}')", "…: must be 1 to …", "must be 1 to …"),
        ("raise unknown('unit', x, y)", "unknown unit …: did you mean …? known: …", "did you mean"),
        ("raise ValueError('something else is wrong')", None, None),
    ],
)
def test_faults_are_read_from_the_source(site, tmp_path, monkeypatch, source, template, remedy):
    index = site[1]
    for package in index.PACKAGES:
        (tmp_path / package).mkdir()
    (tmp_path / "stand" / "a.py").write_text(f"def f(a, b, x, y):\n    {source}\n")
    monkeypatch.setattr(index, "ROOT", tmp_path)
    found = index.faults()
    assert [fault.template for fault in found] == ([] if template is None else [template])
    if template is not None:
        assert found[0].allowed.startswith(remedy)


# Messages that no quick test makes: a driver, a cluster, a disk or a network must fail for them.
# The number falls with each line of tools/site/triggers.py; it may not grow.
WITHOUT_EXAMPLE = 115


def test_every_fault_has_a_remedy_and_most_have_an_example(site):
    """A new message says what is allowed, or owes a line in docs/site/remedies.toml."""
    index = site[1]
    known, stated, seen = index.faults(), index.remedies(), index.examples()
    assert [fault for fault in known if not fault.remedy(stated)] == []
    told = [f"{fault.file} {fault.template}" for fault in known if not fault.allowed]
    idle = [pattern for pattern in stated if not any(re.search(pattern, one) for one in told)]
    assert idle == []  # a remedy of a message that is no more
    without = [f for f in known if not any(f.fits(m) for m in seen.get(f.file, []))]
    assert len(without) <= WITHOUT_EXAMPLE, [fault.template for fault in without]


def test_the_tutorials_are_notebooks_that_end_with_an_answer():
    tutorials = sorted((ROOT / "docs" / "site" / "tutorials").glob("*.md"))
    assert len(tutorials) >= 4
    for path in tutorials:
        text = path.read_text(encoding="utf-8")
        assert text.startswith("---\n"), path.name
        assert "```{code-cell}" in text, path.name
        assert text.count("Question: **") == 1, path.name
        if "needs: propose" not in text:
            assert "**Answer:**" in text, path.name


def test_the_house_is_described_as_it_stands():
    """docs/house.md names every room of every storey, and none that is not there."""
    text = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    plan = text.partition("stand/\n")[2].partition("tests/")[0]
    rooms = {room for storey in STOREYS for room in storey} - {"__main__"}
    assert [room for room in sorted(rooms) if not re.search(rf"\b{room}\b", plan)] == []
    named = re.findall(r"(\w+)/", plan)
    assert [name for name in named if not (ROOT / "stand" / name).is_dir()] == []
