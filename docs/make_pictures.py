"""Make the pictures of the documentation from the demo: docs/report.png, docs/annotate.png and docs/method.png.

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
from typing import Any
from unittest import mock

import av
import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

import cuboid.method.surfaces.frame_segments as frame_segments
import cuboid.method.surfaces.kernels.outlines as kernels
import cuboid.runs.tracking.posed_tracker
from cuboid import Frame, FrameResult, Tracker, open_recording
from cuboid.ground.core.palette import color_of
from cuboid.lab.annotation import Annotator, KeyframesFile, make_server
from cuboid.lab.evaluation import read_truth
from cuboid.method.proposals import make_source
from cuboid.method.surfaces.kernels.outlines import CONTACT, FREE, HIDDEN, SUPPORT, UNSURE
from cuboid.results.files import Results
from cuboid.results.files.naming import renamed_object
from cuboid.results.views.drawing import DARK, WHITE, draw_frame
from cuboid.results.views.overlays import heat_over
from cuboid.results.views.projection import visible_rect
from cuboid.results.views.report import summarise, write_report
from cuboid.results.views.text import put_text

DOCS = Path(__file__).resolve().parent
WIDTH, HEIGHT = 1280, 800
# Frames of the demo that are drawn on before the picture is taken; the next suggested one is shown.
DRAWN = (84, 108, 132)
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# What the demo shows, by label.
NAMES = {2: "cereals", 3: "ball", 4: "bowl", 5: "can", 6: "mug", 7: "book", 8: "milk carton", 9: "cap"}
# The frame of the demo that docs/method.md shows, and the size of each of its pictures.
SHOWN = 40
PANEL = (456, 342)
# What bounds a thing, by kind; the best known of these is drawn where a pixel has several.
BOUNDS = (
    (CONTACT, "contact", (224, 58, 62)),
    (SUPPORT, "support", (64, 132, 255)),
    (FREE, "free", (58, 200, 104)),
    (UNSURE, "unsure", (236, 190, 60)),
    (HIDDEN, "hidden", (150, 154, 160)),
)
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
        write_png(DOCS / "report.png", screenshot(named_page(demo, Path(folder)).as_uri(), turn))
        with annotating(demo, Path(folder) / "keyframes.json") as address:
            write_png(DOCS / "annotate.png", screenshot(address, carry))
        write_png(DOCS / "method.png", method_picture(demo))


def named_page(demo: Path, folder: Path) -> Path:
    """Write the page of the demo with names, as people give them in `cuboid view`; return it."""
    recording = open_recording(demo / "recording").without_poses()
    summary = summarise(Results(demo / "results"), recording.read)
    for item in summary.found.objects:
        if item.label in NAMES:
            summary = summary.named(renamed_object(item, NAMES[item.label]))
    write_report(folder / "report.html", summary)
    return (folder / "report.html").resolve()


def method_picture(demo: Path) -> np.ndarray:
    """Track the demo up to a frame; return that frame at four stages of the method, (H, W, 3), RGB."""
    recording = open_recording(demo / "recording")
    tracker = cuboid.runs.tracking.posed_tracker.PosedTracker(recording.intrinsics)
    for frame in recording.iterate():
        assert isinstance(frame, Frame)
        if frame.index < SHOWN:
            tracker.update(frame)
            continue
        with (
            watching(cuboid.runs.tracking.posed_tracker, "segment_frame") as shared,
            watching(frame_segments, "outlines") as outlined,
        ):
            result = tracker.update(frame)
        seen = {s.label for s in result.sightings}
        hidden = [o for o in tracker.objects if o.label not in seen]
        assert frame.T_world_camera is not None
        boxes = draw_frame(
            frame.color, frame.T_world_camera, recording.intrinsics, result.sightings, hidden, None, tinted=True
        )
        panels = (
            panel(frame.color, "the frame"),
            panel(heat_picture(frame, tracker, result), "2D proposals and the heat of their votes"),
            panel(shares_picture(frame, shared, outlined), "segments of the frame, and what bounds them", BOUNDS),
            panel(boxes, "labelled boxes of the map"),
        )
        return np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])
    raise ValueError(f"the demo has no frame {SHOWN}")


@contextmanager
def watching(owner: Any, name: str) -> Iterator[dict[str, Any]]:
    """Note what a function of a module is given and returns."""
    whole, noted = getattr(owner, name), {}

    def noting(*values: Any) -> Any:
        noted.update(values=values, result=whole(*values))
        return noted["result"]

    with mock.patch.object(owner, name, noting):
        yield noted


def heat_picture(frame: Frame, tracker: Tracker, result: FrameResult) -> np.ndarray:
    """Return the heat over a frame, with the outlines of its 2D proposals."""
    picture = heat_over(frame.color, result.heat)
    proposals = make_source(None)(frame, tracker.intrinsics)
    assert proposals.masks is not None
    for (x0, y0, _, _), mask in zip(proposals.boxes_xyxy.tolist(), proposals.masks, strict=True):
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x0, y0))
        cv2.drawContours(picture, outlines, -1, WHITE, 1, cv2.LINE_AA)
    return picture


class Pixel(int):
    """A number of a segment that knows its place in the picture."""

    place: tuple[int, int]

    @classmethod
    def at(cls, place: tuple[int, int], number: int) -> Pixel:
        """Return the number of the segment at a row and column."""
        pixel = cls(number)
        pixel.place = place
        return pixel


class Kinds:
    """Stands in for the table of counts: notes which pixel each count is of."""

    def __init__(self) -> None:
        self.of: dict[tuple[int, int], set[int]] = {}

    def __getitem__(self, key: Any) -> int:
        return 0

    def __setitem__(self, key: Any, value: int) -> None:
        if isinstance(key, tuple):
            self.of.setdefault(key[0].place, set()).add(int(key[2]))


def shares_picture(frame: Frame, shared: dict[str, Any], outlined: dict[str, Any]) -> np.ndarray:
    """Return a darkened frame with the segments of its pixels, bounded by what bounds them."""
    image, (segmented, *others) = shared["values"][0].image, outlined["values"]
    numbered, kinds = np.empty(segmented.claim.shape, dtype=object), Kinds()
    for place, number in np.ndenumerate(segmented.claim):
        numbered[place] = Pixel.at((place[0], place[1]), int(number))
    # The same functions as in the run, as plain Python: they count into `kinds`.
    plain = {name: value.py_func for name, value in vars(kernels).items() if hasattr(value, "py_func")}
    with mock.patch.multiple(kernels, **plain):
        kernels.outlines(segmented._replace(claim=numbered), *others[:-2], kinds, others[-1].copy())
    picture = np.asarray(frame.color * 0.35, np.uint8)
    step, (x, y) = image.step, image.phase
    for k in range(len(shared["result"].segments)):
        rows, columns = np.nonzero(shared["result"].claim == k)
        paint(picture, rows * step + y, columns * step + x, step, color_of(k + 1), 0.45)
    for kind, _, color in reversed(BOUNDS):
        places = np.array([place for place, found in kinds.of.items() if kind in found], np.int64).reshape(-1, 2)
        paint(picture, places[:, 0] * step + y, places[:, 1] * step + x, step + 1, color, 1.0)
    return picture


def paint(
    picture: np.ndarray, rows: np.ndarray, columns: np.ndarray, size: int, color: tuple[int, int, int], fraction: float
) -> None:
    """Lay a color over squares of a picture (H, W, 3)."""
    cover = np.zeros(picture.shape[:2], bool)
    for v in range(size):
        for u in range(size):
            cover[np.minimum(rows + v, cover.shape[0] - 1), np.minimum(columns + u, cover.shape[1] - 1)] = True
    picture[cover] = (fraction * np.array(color) + (1.0 - fraction) * picture[cover]).astype(np.uint8)


def panel(
    picture: np.ndarray, title: str, legend: tuple[tuple[int, str, tuple[int, int, int]], ...] = ()
) -> np.ndarray:
    """Return a picture at the size of a panel, with a title and what its colors mean."""
    small = np.ascontiguousarray(cv2.resize(picture, PANEL, interpolation=cv2.INTER_AREA))
    small[:26] = (0.3 * small[:26] + 0.7 * np.array(DARK)).astype(np.uint8)
    put_text(small, title, 8, 4, 15, WHITE)
    if legend:
        small[-24:] = (0.3 * small[-24:] + 0.7 * np.array(DARK)).astype(np.uint8)
    for k, (_, name, color) in enumerate(legend):
        left = 10 + 88 * k
        small[PANEL[1] - 17 : PANEL[1] - 7, left : left + 10] = color
        put_text(small, name, left + 16, PANEL[1] - 22, 14, WHITE)
    return small


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
