"""Make the picture of the 3D page from the demo: docs/report.png.

    python docs/make_pictures.py [--demo DIR]

Needs the development requirements and a chromium (Debian: apt-get install chromium fonts-inter). The demo is made
anew unless DIR holds one already (`cuboid demo --output DIR`).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

PICTURE = Path(__file__).resolve().parent / "report.png"
WIDTH, HEIGHT = 1280, 800
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# The README is fetched by everybody who looks: 256 colors, spread by error diffusion, look the same here.
PALETTE = ("palettegen", "max_colors=256:stats_mode=full:reserve_transparent=0"), ("paletteuse", "dither=sierra2_4a")


def main() -> None:
    """Make the demo if it is wanted, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--demo", type=Path, metavar="DIR", help="a demo that is there already")
    demo = parser.parse_args().demo
    with tempfile.TemporaryDirectory() as folder:
        if demo is None:
            demo = Path(folder) / "demo"
            subprocess.run([sys.executable, "-m", "cuboid", "demo", "--output", str(demo), "--no-video"], check=True)
        write_png(PICTURE, screenshot((demo / "results" / "report.html").resolve()))
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1e3:.0f} kB")


def screenshot(report: Path) -> np.ndarray:
    """Return the page as people see it who have turned the scene and chosen an object, (H, W, 3), RGB."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
        page = browser.new_page(
            viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="dark", reduced_motion="reduce"
        )
        page.goto(report.as_uri())
        page.wait_for_selector("body[data-ready]", timeout=60_000)
        turn(page)
        content = page.screenshot()
        browser.close()
    shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    return np.ascontiguousarray(shown[..., ::-1])


def turn(page: Page) -> None:
    """Step back, turn and move a little, so that the camera's path is in view; choose an object."""
    page.mouse.move(480, 300)
    page.mouse.wheel(0, 90)
    page.mouse.down()
    page.mouse.move(506, 316, steps=4)
    page.mouse.up()
    page.mouse.move(800, 400)
    page.mouse.down(button="right")
    page.mouse.move(736, 376, steps=4)
    page.mouse.up(button="right")
    page.locator("#plot [data-row]").nth(1).click()
    page.mouse.move(640, 26)
    page.wait_for_timeout(1000)


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3), RGB, as a PNG with a palette of its own."""
    height, width = picture.shape[:2]
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=width, height=height, format=av.VideoFormat("rgb24", width, height), time_base=Fraction(1)
    )
    split, sink = graph.add("split"), graph.add("buffersink")
    make, use = (graph.add(*step) for step in PALETTE)
    source.link_to(split)
    split.link_to(make, 0, 0)
    split.link_to(use, 1, 0)
    make.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
    frame.pts, frame.time_base = 0, Fraction(1)
    graph.push(frame)
    graph.push(None)
    encoder = av.CodecContext.create("png", "w")
    encoder.width, encoder.height, encoder.pix_fmt, encoder.time_base = width, height, "pal8", Fraction(1)
    encoder.options = {"compression_level": "9"}
    packets = [*encoder.encode(graph.pull()), *encoder.encode(None)]
    path.write_bytes(b"".join(bytes(packet) for packet in packets))


if __name__ == "__main__":
    main()
