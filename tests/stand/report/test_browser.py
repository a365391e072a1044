"""Reports in a real browser: nothing to complain of, readable by day, by night and on paper."""

import re
import shutil
import subprocess
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from calibrations import a_full_record
from matplotlib.image import imread
from pages import Page
from rehearsed import answer, verified

import stand
from stand.calibration.limits import Limits
from stand.evaluation.allan import analyse
from stand.physics.picture import NoDriver
from stand.recording.mcap.writer import write_imu_log
from stand.rehearsal.result import Verdict
from stand.report import gallery
from stand.report.allan import page as allan_page
from stand.report.allan import picture as allan_picture
from stand.report.certificate import page as certificate
from stand.report.log_page import page as log_page
from stand.report.rehearsal import page
from stand.report.run_page import write_run_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
]
WIDTH, HEIGHT = 1280, 4000
PAPER = {"light": (255, 255, 255), "dark": (21, 24, 29)}  # #ffffff, #15181d
BAND = {"light": (204, 231, 224), "dark": (25, 55, 51)}  # a fifth of #008562, #2bb58c on paper
BARS = {"light": (0, 114, 178), "dark": (58, 155, 217)}  # #0072b2, #3a9bd9: the first hue
ACCENT = {"FAIL": (166, 58, 0), "PASS": (0, 109, 75), "INDETERMINATE": (122, 91, 0)}  # by day


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What the browser made of a page: its DOM, its complaints, its screen (h, w, 3), its PDF."""

    dom: Page
    console: list[str]
    screen: np.ndarray
    pdf: bytes

    def share(self, colour: tuple[int, int, int], within: int = 0) -> float:
        """Part of the screen that is of one colour, up to so much in each of red, green, blue."""
        return float(np.mean(np.all(np.abs(self.screen - colour) <= within, axis=2)))


def seen(
    text: str, folder: Path, theme: str = "light", width: int = WIDTH, flags: tuple[str, ...] = ()
) -> Seen:
    """Open a page once, without a network to ask."""
    assert CHROMIUM is not None
    folder.mkdir(exist_ok=True)
    html, screen, pdf = (folder / name for name in ("page.html", "screen.png", "page.pdf"))
    html.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [
            CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            "--no-first-run", "--disable-background-networking", "--no-pdf-header-footer",
            f"--user-data-dir={folder / 'profile'}", "--enable-logging=stderr",
            "--force-device-scale-factor=1", f"--window-size={width},{HEIGHT}",
            f"--blink-settings=preferredColorScheme={'0' if theme == 'dark' else '1'}",
            f"--screenshot={screen}", f"--print-to-pdf={pdf}", "--dump-dom", *flags, html.as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    shown = np.round(imread(screen)[..., :3] * 255).astype(int)
    return Seen(Page(done.stdout), console, shown, pdf.read_bytes())


@pytest.fixture
def undrawn(monkeypatch):
    """Pages without pictures of the stand: those take as long as the browser."""

    def refuse(*_):
        raise NoDriver("none wanted")

    monkeypatch.setattr(gallery, "pictures", refuse)


@pytest.fixture(scope="module")
def by_theme(tmp_path_factory):
    root = tmp_path_factory.mktemp("browser")
    text = page(verified(Verdict.FAIL, heading=0.7))
    return {theme: seen(text, root / theme, theme) for theme in ("light", "dark")}


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_rehearsal_opens_without_complaint(by_theme, theme):
    opened = by_theme[theme]
    assert opened.console == []
    assert "✗ CONTRADICTED" in opened.dom.said
    assert "Will not be met: heading within 0.05°." in opened.dom.said
    assert "Verified by 400 runs 4 of 5 predictions agree with the runs" in opened.dom.said
    assert "0.70 (0.65 to 0.75) contradicted" in opened.dom.said
    assert len(opened.dom.of("svg")) == 4
    assert len(opened.dom.of("img")) == 3  # two positions, the first on the first screen too
    corner = tuple(opened.screen[2, 2])
    assert corner == PAPER[theme]
    # Bars of the timeline and of the budget: two thirds of the width, 4 rows of 20 pixels and
    # more, of 4000. Without them letters alone would have that colour nowhere.
    assert opened.share(BARS[theme]) > 0.005
    assert opened.share(PAPER[theme]) > 0.5
    # The band of the ratios is 4 rows of 30 pixels high and a tenth of the width; the mix of two
    # colours may be rounded either way.
    assert opened.share(BAND[theme], within=1) > 0.001


def test_figures_and_letters_change_with_the_theme(by_theme):
    light, dark = by_theme["light"], by_theme["dark"]
    assert light.share(BARS["dark"]) < 1e-4
    assert dark.share(BARS["light"]) < 1e-4
    ink = {"light": (27, 31, 36), "dark": (230, 232, 235)}  # #1b1f24, #e6e8eb
    assert light.share(ink["light"]) > 1e-3
    assert dark.share(ink["dark"]) > 1e-3


def test_on_paper_it_is_light_and_has_pages(by_theme):
    for opened in by_theme.values():
        assert opened.pdf.startswith(b"%PDF")
        pages = re.findall(rb"/Type\s*/Page\b", opened.pdf)
        assert 3 <= len(pages) <= 8


@pytest.mark.parametrize("verdict", [Verdict.PASS, Verdict.INDETERMINATE])
def test_each_verdict_has_its_colour(tmp_path, undrawn, verdict):
    opened = seen(page(answer(verdict)), tmp_path / "page")
    assert opened.console == []
    counts = Counter({name: opened.share(colour) for name, colour in ACCENT.items()})
    assert counts.most_common(1)[0][0] == verdict.value


def test_a_narrow_screen_scrolls_tables_and_not_the_page(tmp_path, undrawn):
    text = page(answer(Verdict.FAIL))
    opened = seen(text, tmp_path / "page", width=500)
    assert opened.screen.shape[1] == 500
    assert tuple(opened.screen[2, -2]) == PAPER["light"]
    # The right edge of the verdict's frame is where the margin of 1 rem (15 px) begins: were
    # anything wider than the screen, it would lie outside. Round corners blur two pixels.
    accent = np.all(opened.screen == ACCENT["FAIL"], axis=2).any(axis=0)
    assert accent.nonzero()[0].max() == pytest.approx(500 - 15, abs=4)


def noise_alone(path):
    """A minute of rest at 20 Hz, Y1 up: white noise of 1e-4 rad/s and 1e-2 m/s^2."""
    rng = np.random.default_rng(2)
    n = 1200
    f = [0, 9.81, 0] + 1e-2 * rng.standard_normal((n, 3))
    w = 1e-4 * rng.standard_normal((n, 3))
    write_imu_log(path, t_ns=(np.arange(n) + 1) * 50_000_000, w_ib_b=w, f_b=f, metadata={})
    return path


def run_page(folder, out):
    return write_run_page(folder, out).read_text(encoding="utf-8")


def kinds(recorded, log):
    """A page of each kind that a command writes, by its name."""
    copy = stand.read(log)
    allan = analyse(log, imu="stim300")
    picture = allan_picture(allan)
    edges = stand.simulate(stand.settings("tumble-6", imu="stim300", rate_hz=5, seed=3))
    return {
        "rehearsal": page(verified(Verdict.FAIL, heading=0.7)),
        "run": run_page(recorded.folder, log.with_name("run.html")),
        "log": log_page(copy, "stim300"),
        "allan": allan_page(allan, picture, picture),
        "certificate": certificate(stand.calibrate(edges)),
    }


def test_no_page_of_any_kind_is_wider_than_the_screen(recorded, tmp_path, undrawn):
    """Telephone, tablet, desk: the browser's own windows are 500 wide at least, frames are not.

    The first screen of each has its verdict, and below it or beside it begins what is seen; on a
    telephone no frame of a verdict ends beyond the margin of 16 points.
    """
    folder = tmp_path / "page"
    folder.mkdir()
    rest = noise_alone(tmp_path / "rest.mcap")
    for name, text in kinds(recorded, rest).items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    measure = (
        "const d = this.contentDocument, r = d.documentElement;"
        "const v = d.querySelector('#verdict').getBoundingClientRect();"
        "document.querySelector('p').textContent += [this.title, this.clientWidth, r.scrollWidth,"
        "Math.round(v.right), v.top < 400].join(' ') + '; '"
    )
    frames = "".join(
        f'<iframe title="{file.stem}" src="{file.name}" onload="{measure}" '
        f'style="width: {width}px; height: 3000px; border: 0"></iframe>'
        for file in sorted(folder.glob("*.html"))
        for width in (390, 768, 1440)
    )
    opened = seen(f"<p></p>{frames}", folder, flags=("--allow-file-access-from-files",))
    assert opened.console == []
    told = [row.split() for row in opened.dom.said.split(";") if row.strip()]
    assert len(told) == 5 * 3
    for name, width, scrolled, right, high in told:
        assert scrolled == width, (name, width, scrolled)
        assert int(right) <= int(width) - 16, (name, width, right)
        assert high == "true", name


def test_a_recorded_run_opens_without_complaint(recorded, tmp_path, undrawn):
    text = write_run_page(recorded.folder, tmp_path / "run.html").read_text(encoding="utf-8")
    opened = seen(text, tmp_path / "page")
    assert opened.console == []
    assert "Recorded run: Short test" in opened.dom.said
    assert len(opened.dom.of("svg")) == 5  # the channels with them
    assert opened.share(BARS["light"]) > 0.0005


def test_a_certificate_opens_by_night_and_is_printed(tmp_path):
    """Its verdict, two figures, some sheets of paper."""
    limits = Limits(2.0, {("gyro", "bias"): (1e-5, "limits.toml")})  # 2 deg/h, of 8, -10, 12
    opened = seen(certificate(a_full_record(), limits), tmp_path / "page", "dark", width=768)
    assert opened.console == []
    assert "✗ FAIL" in opened.dom.said
    assert tuple(opened.screen[2, 2]) == PAPER["dark"]
    assert len(opened.dom.of("svg")) == 2
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", opened.pdf)) <= 5


SHAPES = ((768, "light"), (1440, "dark"))


@pytest.fixture(scope="module")
def run_pages(recorded, tmp_path_factory):
    """The page of a run with pictures that cost nothing: each a square of one grey."""
    root = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        grey = np.full((30, 30, 3), 128, np.uint8)
        patch.setattr(gallery, "pictures", lambda joints, *_: [grey] * len(joints))
        text = write_run_page(recorded.folder, root / "run.html").read_text(encoding="utf-8")
    shown = {f"{w} {t}": seen(text, root / f"{w}{t}", t, width=w) for w, t in SHAPES}
    return text, shown


def test_the_first_screen_of_a_run_has_verdict_sentence_and_picture(run_pages):
    """Beside one another where there is room, and in the first 500 points of the page."""
    for name, opened in run_pages[1].items():
        assert opened.console == []
        assert "angles are within 3 of their predicted sigmas" in opened.dom.said
        first = opened.screen[:500]
        picture = np.all(first == 128, axis=2)
        assert picture.mean() > 0.05, name
        columns = picture.any(axis=0).nonzero()[0]
        assert columns.min() > opened.screen.shape[1] / 2  # at the right of the verdict
        assert opened.screen.shape[1] - columns.max() > 15  # within the margin
        theme = name.split()[1]
        assert tuple(opened.screen[2, 2]) == PAPER[theme]


def test_on_paper_a_run_keeps_its_first_screen_on_its_first_page(run_pages):
    pdf = run_pages[1]["768 light"].pdf
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 10


def test_on_a_telephone_the_picture_of_a_run_stands_below_the_verdict(run_pages, tmp_path):
    """390 wide: nothing is wider, and the picture begins where the verdict ends."""
    (tmp_path / "page").mkdir()
    (tmp_path / "page" / "inner.html").write_text(run_pages[0], encoding="utf-8")
    measure = (
        "const d = document.querySelector('iframe').contentDocument, r = d.documentElement;"
        "const top = q => d.querySelector(q).getBoundingClientRect();"
        "document.querySelector('p').textContent = [r.scrollWidth, "
        "top('.first img').top > top('#verdict').bottom].join(' ')"
    )
    opened = seen(
        f'<iframe src="inner.html" style="width: 390px; height: 3000px; border: 0" '
        f'onload="{measure}"></iframe><p>not measured</p>',
        tmp_path / "page",
        flags=("--allow-file-access-from-files",),
    )
    assert opened.dom.said == "390 true"
    assert opened.console == []


def test_a_page_that_asks_for_more_would_be_seen(tmp_path, undrawn):
    text = page(answer(Verdict.PASS)).replace(
        "</main>", '<img src="beside.png" alt="x"><script>alert(1)</script></main>'
    )
    opened = seen(text, tmp_path / "page")
    assert any("Content Security Policy" in line for line in opened.console)
