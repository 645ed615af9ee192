"""Photograph a report for the README: `python renders/report.py RESULT` (see there for the command that makes one).

It needs Chromium and `pip install playwright`.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

PICTURE = Path(__file__).parent / "report.jpg"
WIDTH = 1000  # of the window, pixels
QUALITY = 68  # of JPEG: letters are clear, and the file has about 120 kB
# WebGL2 without a graphics card.
OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def photograph(report: Path) -> None:
    """The viewer of photographs and the relighting, one above the other."""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        page = browser.new_page(viewport={"width": WIDTH, "height": 2000})
        page.goto(report.absolute().as_uri())
        page.wait_for_selector("#relight[data-ready]")
        page.wait_for_selector("#viewer[data-shown]")
        top, end = (page.locator(place).bounding_box() for place in ("#viewer", "section#relight"))
        clip = {"x": 0, "y": top["y"] - 12, "width": WIDTH, "height": end["y"] + end["height"] - top["y"] + 20}
        page.screenshot(path=PICTURE, clip=clip, full_page=True, type="jpeg", quality=QUALITY)
        browser.close()


if __name__ == "__main__":
    photograph(Path(sys.argv[1]) / "report.html")
