"""Make the pictures of the pages from the demo: docs/report.png and docs/annotate.png.

    python docs/make_pictures.py [--demo DIR]

Needs the development requirements and a chromium (Debian: apt-get install chromium fonts-inter). The demo is made
anew unless DIR holds one already (`cuboid demo --output DIR`).
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

from cuboid import open_recording
from cuboid.annotation import Annotator, KeyframesFile, make_server
from cuboid.evaluation import read_truth
from cuboid.views.projection import visible_rect

DOCS = Path(__file__).resolve().parent
WIDTH, HEIGHT = 1280, 800
# Frames of the demo that are drawn on before the picture is taken; the next suggested one is shown.
DRAWN = (84, 108, 132)
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# The README is fetched by everybody who looks: 256 colors, spread by error diffusion, look the same here.
PALETTE = ("palettegen", "max_colors=256:stats_mode=full:reserve_transparent=0"), ("paletteuse", "dither=sierra2_4a")


def main() -> None:
    """Make the demo if it is wanted, take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--demo", type=Path, metavar="DIR", help="a demo that is there already")
    demo = parser.parse_args().demo
    with tempfile.TemporaryDirectory() as folder:
        if demo is None:
            demo = Path(folder) / "demo"
            subprocess.run([sys.executable, "-m", "cuboid", "demo", "--output", str(demo), "--no-video"], check=True)
        write_png(DOCS / "report.png", screenshot((demo / "results" / "report.html").resolve().as_uri(), turn))
        with annotating(demo, Path(folder) / "keyframes.json") as address:
            write_png(DOCS / "annotate.png", screenshot(address, carry))


def screenshot(address: str, use: Callable[[Page], None]) -> np.ndarray:
    """Return a page after some use of it, (H, W, 3), RGB."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
        page = browser.new_page(
            viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="dark", reduced_motion="reduce"
        )
        page.goto(address)
        page.wait_for_selector("body[data-ready]", timeout=60_000)
        use(page)
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


@contextmanager
def annotating(demo: Path, keyframes: Path) -> Iterator[str]:
    """Serve the page for drawing, with what two frames of the demo show drawn."""
    recording, truth = open_recording(demo / "recording"), read_truth(demo / "recording")
    assert truth.visibility is not None
    objects = [{"id": item.id, "name": item.name} for item in truth.objects]
    frames = []
    for frame in DRAWN:
        T_world_camera, boxes = recording.pose(frame), []
        for item, visible in zip(truth.objects, truth.visibility[frame], strict=True):
            rect = visible_rect(item.box, T_world_camera, recording.intrinsics)
            if rect is not None and visible > 0:
                boxes.append({"id": item.id, "rect": rect.round().astype(int).tolist(), "visible": round(visible, 2)})
        frames.append({"frame": frame, "boxes": boxes})
    document = {"format": "cuboid-keyframes", "version": 1, "objects": objects, "frames": frames}
    keyframes.write_text(json.dumps(document), encoding="utf-8")
    with make_server(Annotator(recording, KeyframesFile(keyframes, recording), 8)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_port}/"
        server.shutdown()


def carry(page: Page) -> None:
    """Go on to the next frame, where what was drawn before is dashed; take over some of it, choose one."""
    page.keyboard.press("PageDown")
    page.wait_for_selector("[data-ghost]")
    ghosts = page.locator("[data-ghost] .line")
    for _ in range(ghosts.count() // 2):
        place = ghosts.first.bounding_box()
        assert place is not None
        page.mouse.click(place["x"] + 3, place["y"] + place["height"] - 3)
        page.wait_for_timeout(100)
    page.mouse.move(640, 26)
    page.wait_for_selector("body[data-saved=saved]")


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
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
