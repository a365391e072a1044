"""Every page of the site in a browser without a screen: complaints, links, search; pictures.

    python tools/site/look.py                       # all pages and a search: complaints, exit code
    python tools/site/look.py index.html shots      # screenshots at three widths, light and dark

Pages are opened from the disk (file://), as a reader without a server does.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parents[2]
HTML = ROOT / "build" / "docs" / "html"
WIDTHS = (390, 768, 1440)
SEARCHED = "carousel"
CHATTER = '"[PST]: '  # the theme says which light it shows a page by
_ALL = """<!doctype html><title>all</title><p id="done">0</p>
<iframe width="1200" height="800"></iframe>
<script>
const pages = %s, frame = document.querySelector("iframe");
let k = 0;
function next() {
  if (k < pages.length) { document.querySelector("#done").textContent = k; frame.src = pages[k++]; }
  else document.querySelector("#done").textContent = "all " + pages.length;
}
frame.onload = () => setTimeout(next, 50);
next();
</script>"""


def chromium() -> str:
    """The browser, or an end in one line."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        sys.exit("no chromium: apt-get install chromium")
    return found


def opened(url: str, *flags: str, minutes: float = 2.0) -> tuple[str, list[str]]:
    """The page as it stands in the end, and its complaints."""
    with TemporaryDirectory() as profile:
        done = subprocess.run(
            [
                chromium(), "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                "--no-first-run", "--disable-background-networking", "--enable-logging=stderr",
                "--allow-file-access-from-files", f"--user-data-dir={profile}", *flags, url,
            ],
            capture_output=True, text=True, timeout=60 * minutes, check=True,
        )  # fmt: skip
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout, [line for line in said if CHATTER not in line]


def complaints(html: Path = HTML) -> list[str]:
    """What the browser says of any page, and of a search from the disk."""
    pages = sorted(p.relative_to(html).as_posix() for p in html.rglob("*.html")
                   if "_static" not in p.parts)  # fmt: skip
    harness = html / "_all_pages.html"
    harness.write_text(_ALL % pages, encoding="utf-8")
    try:
        dom, said = opened(
            harness.as_uri(), "--virtual-time-budget=600000", "--dump-dom", minutes=8
        )
    finally:
        harness.unlink()
    if f"all {len(pages)}" not in dom:
        said.append("not all pages were opened: " + str(re.findall(r'id="done">[^<]*', dom)))
    dom, more = opened(
        f"{(html / 'search.html').as_uri()}?q={SEARCHED}", "--virtual-time-budget=20000",
        "--dump-dom",
    )  # fmt: skip
    found = re.findall(r'<li[^>]*>\s*<a href="([^"]+)"', dom)
    if not any(SEARCHED in address for address in found):
        said.append(f"a search for {SEARCHED} from the disk finds nothing of it: {found[:5]}")
    return said + more


def broken_links(html: Path = HTML) -> list[str]:
    """Links within the site to a file, or to a place in a page, that is not there."""
    pages = {path: path.read_text(encoding="utf-8") for path in html.rglob("*.html")
             if "_static" not in path.parts}  # fmt: skip
    places = {path: set(re.findall(r'id="([^"]+)"', text)) for path, text in pages.items()}
    broken = []
    for path, text in pages.items():
        for link in set(re.findall(r'(?:href|src)="([^"]+)"', text)):
            if re.match(r"[a-z]+:", link):
                continue
            file, _, place = map(unquote, link.partition("#"))
            target = (path.parent / file.partition("?")[0]).resolve() if file else path
            if not target.exists() or (place and place not in places.get(target, {place})):
                broken.append(f"{path.relative_to(html)}: leads to nothing: {link}")
    return broken


def shots(page: Path, folder: Path) -> list[Path]:
    """Screenshots of a page at `WIDTHS`, by day and by night, and its PDF."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for theme, flag in (("light", "1"), ("dark", "0")):
        for width in WIDTHS:
            target = folder / f"{page.stem}-{width}-{theme}.png"
            _shot(page, target, width, flag)
            made.append(target)
    pdf = folder / f"{page.stem}.pdf"
    opened(page.as_uri(), f"--print-to-pdf={pdf}", "--no-pdf-header-footer")
    return [*made, pdf]


def _shot(page: Path, target: Path, width: int, theme: str) -> None:
    """Windows are 500 wide at least: a narrower page stands in a frame."""
    flags = (f"--screenshot={target}", f"--blink-settings=preferredColorScheme={theme}",
             "--force-device-scale-factor=1", "--virtual-time-budget=8000")  # fmt: skip
    if width >= 500:
        opened(page.as_uri(), *flags, f"--window-size={width},1400")
        return
    with TemporaryDirectory() as folder:
        frame = Path(folder) / "frame.html"
        frame.write_text(
            '<body style="margin:0"><iframe style="border:0" '
            f'width="{width}" height="1400" src="{page.as_uri()}"></iframe>', encoding="utf-8"
        )  # fmt: skip
        opened(frame.as_uri(), *flags, "--window-size=500,1400")


def _main() -> int:
    if len(sys.argv) == 3:
        for path in shots((HTML / sys.argv[1]).resolve(), Path(sys.argv[2])):
            print(path)
        return 0
    said = [*broken_links(HTML.resolve()), *complaints()]
    print("\n".join(said) or "every page opens without complaint; the search works from the disk")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(_main())
