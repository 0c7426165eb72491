#!/usr/bin/env python3
"""Photograph pages on a wide screen and on a phone, light and dark, and say which do not fit.

    tools/photograph_pages.py RUN/report/report.html http://127.0.0.1:8000/ --out pictures

Needs Chromium and playwright. The pictures of docs/images are made with it, by --only and --height.
Exit code: 0 all pages fit, 1 one scrolls sideways or has an error of its script, 2 wrong arguments.
"""

from __future__ import annotations

import argparse
import io
import pathlib
import shutil
import sys

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

WIDTHS = {"wide": 1440, "phone": 390}
SCHEMES = ("light", "dark")
COLOURS = 128  # of a picture
LONGEST = 12_000  # pixels of a picture
SETTLING = 1500  # ms until figures are drawn; viewers with a globe take longer: --wait
FLAGS = (
    "--headless --no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader "
    "--enable-unsafe-swiftshader"
).split()


def photograph(
    browser: Browser, address: str, path: pathlib.Path, width: int, scheme: str, **options: int
) -> list[str]:
    """Write the picture of a page; return what is wrong with it, one line each."""
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)  # type: ignore[arg-type]
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(f"{path.stem}: {error}"))
    page.goto(address)
    page.wait_for_timeout(options["wait"])
    size = "document.documentElement.scroll{0} - document.documentElement.client{0}"
    excess = page.evaluate(size.format("Width"))
    if excess > 0:
        faults.append(f"{path.stem}: scrolls sideways by {excess} px")
    height = page.evaluate("document.documentElement.scrollHeight")
    shown = {"x": 0, "y": 0, "width": width, "height": min(height, options["height"])}
    taken = page.screenshot(full_page=True, clip=shown)  # type: ignore[arg-type]
    page.close()
    with Image.open(io.BytesIO(taken)) as picture:
        plain = picture.convert("RGB")
    # The octree keeps the few pixels of thin lines in their colours.
    reduced = plain.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    reduced.save(path, optimize=True)
    return faults


def main() -> int:
    """Photograph the pages of the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="+", help="HTML files or addresses")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("pictures"))
    parser.add_argument("--only", metavar="WIDTH_SCHEME", help="for example phone_dark")
    parser.add_argument("--height", type=int, default=LONGEST, help="pixels from the top")
    parser.add_argument("--wait", type=int, default=SETTLING, help="ms before the picture")
    given = parser.parse_args()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        parser.error("needs Chromium (Debian: apt install chromium)")
    absent = [
        page for page in given.pages if "://" not in page and not pathlib.Path(page).is_file()
    ]
    if absent:
        parser.error(f"no file '{absent[0]}'")
    given.out.mkdir(parents=True, exist_ok=True)
    faults: list[str] = []
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=FLAGS)
        for number, page in enumerate(given.pages, 1):
            is_address = "://" in page
            address = page if is_address else pathlib.Path(page).resolve().as_uri()
            name = f"page_{number}" if is_address else pathlib.Path(page).stem
            for kind, width in WIDTHS.items():
                for scheme in SCHEMES:
                    if given.only in (None, f"{kind}_{scheme}"):
                        path = given.out / f"{number}_{name}_{kind}_{scheme}.png"
                        options = {"wait": given.wait, "height": given.height}
                        faults += photograph(browser, address, path, width, scheme, **options)
        browser.close()
    print("\n".join(faults) or f"{len(given.pages)} pages fit: {given.out}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
