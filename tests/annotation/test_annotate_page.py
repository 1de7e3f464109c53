"""Drawing keyframes in a real browser: by mouse, by keys, and what is in the file after each change."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page

from browser import VIEWPORT, Watched, answering, browser, pixels
from cuboid import open_recording
from cuboid.lab.annotation import Annotator, KeyframesFile, make_server
from cuboid.lab.evaluation import evaluate_keyframes, read_keyframes
from fakes import write_recording

FRAMES, HEIGHT, WIDTH, EVERY = 12, 120, 160, 5


@dataclass
class Desk:
    """A page that shows a recording, and the file that it writes."""

    watched: Watched
    file: Path
    address: str

    @property
    def page(self) -> Page:
        return self.watched.page

    def open(self) -> None:
        self.watched.open(self.address)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a place of the picture is on the screen."""
        drawing = self.page.locator("#drawing")
        place, view = drawing.bounding_box(), drawing.get_attribute("data-view")
        zoom, left, top = map(float, view.split())
        return place["x"] + left + zoom * x, place["y"] + top + zoom * y

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        self.page.mouse.move(*self.at(*start))
        self.page.mouse.down()
        self.page.mouse.move(*self.at(*[(a + b) / 2 for a, b in zip(start, end, strict=True)]))
        self.page.mouse.move(*self.at(*end))
        self.page.mouse.up()

    def click(self, x: float, y: float) -> None:
        self.page.mouse.click(*self.at(x, y))

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def go(self, key: str, frame: int) -> None:
        self.press(key)
        self.page.wait_for_selector(f"body[data-shown='{frame}']")

    def saved(self) -> dict[str, Any]:
        """What is in the file, when all is saved."""
        self.page.wait_for_selector("body[data-saved='saved']")
        document: dict[str, Any] = json.loads(self.file.read_text())
        return document

    def boxes(self, frame: int) -> dict[int, list[int]]:
        frames = {item["frame"]: item for item in self.saved()["frames"]}
        return {box["id"]: box["rect"] for box in frames[frame]["boxes"]} if frame in frames else {}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall at 1.5 m, the camera moving 1 cm a frame to the right: things move 1.07 pixels to the left."""
    path = write_recording(tmp_path_factory.mktemp("annotate") / "recording", FRAMES, (HEIGHT, WIDTH))
    for i in range(FRAMES):
        bgr = np.full((HEIGHT, WIDTH, 3), (200, 100, 10 * i), np.uint8)
        cv2.imwrite(str(path / "color" / f"{i:06d}.png"), bgr)
    return path


@pytest.fixture(scope="module")
def watched() -> Iterator[Watched]:
    with browser() as launched:
        yield Watched(launched)


@pytest.fixture
def desk(recording: Path, watched: Watched, tmp_path: Path) -> Iterator[Desk]:
    watched.complaints.clear()
    watched.requests.clear()
    opened, path = open_recording(recording), tmp_path / "drawn.json"
    with make_server(Annotator(opened, KeyframesFile(path, opened), EVERY)) as server, answering(server):
        desk = Desk(watched, path, f"http://localhost:{server.server_port}/")
        desk.open()
        yield desk
        watched.page.goto("about:blank")


def test_ten_minutes_of_drawing(desk: Desk) -> None:
    page = desk.page
    assert page.inner_text("#frame-number") == f"0 / {FRAMES - 1}"
    assert not desk.file.exists()
    # A rectangle, and its name at once.
    desk.drag((20, 30), (60, 80))
    page.keyboard.type("mug")
    desk.press("Enter")
    assert desk.boxes(0) == {1: [20, 30, 60, 80]}
    assert [item["name"] for item in desk.saved()["objects"]] == ["mug"]
    # Another one, drawn from its lower right; how much of it is seen, and that it is a group.
    desk.press("Escape")
    desk.drag((150, 110), (100, 60))
    desk.press("Enter", "6", "g", "Escape")
    assert desk.boxes(0) == {1: [20, 30, 60, 80], 2: [100, 60, 150, 110]}
    assert desk.saved()["frames"][0]["boxes"][1]["visible"] == 0.6
    assert desk.saved()["objects"][1]["group"] is True
    # A place that counts neither way.
    desk.press("i")
    desk.drag((0, 0), (30, 10))
    assert desk.saved()["frames"][0]["ignore"] == [[0, 0, 30, 10]]
    desk.press("o", "Escape")
    # The next suggested frame, 5 cm further: everything is carried 5.33 pixels to the left.
    desk.go("PageDown", EVERY)
    assert page.locator("[data-ghost]").count() == 2
    assert desk.boxes(EVERY) == {}
    desk.press("c")
    assert desk.boxes(EVERY) == {1: [15, 30, 55, 80], 2: [95, 60, 145, 110]}
    assert desk.saved()["frames"][1]["boxes"][1]["visible"] == 0.6
    assert len(desk.saved()["frames"][1]["ignore"]) == 1
    # It is a file of keyframes, with which a result can be judged.
    found = read_keyframes(desk.file)
    assert [(item.id, item.name, item.group) for item in found.objects] == [(1, "mug", False), (2, "thing 2", True)]
    sightings = desk.file.with_name("sightings.csv")
    sightings.write_text("frame,label,x0,y0,x1,y1\n0,7,20,30,60,80\n5,7,15,30,55,80\n")
    scores = evaluate_keyframes(sightings, desk.file).at[0]
    assert (scores.recall, scores.precision, scores.one_label) == (0.5, 1.0, 1.0)
    assert desk.watched.complaints == []
    assert all(address.startswith(desk.address) for address in desk.watched.requests)


def test_rectangles_are_moved_resized_and_deleted(desk: Desk) -> None:
    desk.drag((40, 40), (80, 70))
    desk.press("Enter")
    desk.drag((60, 55), (70, 65))  # by its middle
    assert desk.boxes(0) == {1: [50, 50, 90, 80]}
    desk.drag((90, 80), (100, 90))  # by its corner
    assert desk.boxes(0) == {1: [50, 50, 100, 90]}
    desk.drag((75, 50), (75, 40))  # by its upper side
    assert desk.boxes(0) == {1: [50, 40, 100, 90]}
    desk.drag((75, 60), (300, 60))  # no further than the picture goes
    assert desk.boxes(0) == {1: [110, 40, 160, 90]}
    desk.press("Alt+ArrowLeft", "Alt+Shift+ArrowUp")
    assert desk.boxes(0) == {1: [109, 30, 159, 80]}
    desk.drag((109, 50), (170, 50))  # a side over the other one: turned round, not lost
    assert desk.boxes(0) == {1: [159, 30, 160, 80]}
    desk.press("Delete")
    assert desk.boxes(0) == {}
    assert desk.saved()["frames"][0]["boxes"] == []  # still a keyframe: nothing is to be found in it


def test_each_step_can_be_undone_and_done_again(desk: Desk) -> None:
    desk.drag((10, 10), (40, 40))
    desk.page.keyboard.type("box")
    desk.press("Enter", "Escape")
    desk.drag((60, 60), (90, 90))
    desk.press("Enter", "Delete")
    assert list(desk.boxes(0)) == [1]
    desk.go("ArrowRight", 1)
    desk.press("Control+z")
    desk.page.wait_for_selector("body[data-shown='0']")  # where it was deleted
    assert list(desk.boxes(0)) == [1, 2]
    desk.press("Control+z")
    assert list(desk.boxes(0)) == [1]
    desk.press("Control+Shift+z")
    assert list(desk.boxes(0)) == [1, 2]
    desk.page.click("#undo")
    desk.page.click("#undo")  # the name, typed in one go
    assert desk.saved()["objects"] == [{"id": 1, "name": "thing 1"}]
    desk.page.click("#undo")
    assert desk.saved()["frames"] == []
    assert desk.page.is_disabled("#undo")


def test_what_lies_beneath_can_be_chosen_and_drawn(desk: Desk) -> None:
    desk.drag((20, 20), (140, 100))
    desk.press("Enter", "Escape")
    desk.drag((50, 40), (90, 80))  # inside the first one, which is not chosen any more
    desk.press("Enter")
    assert desk.boxes(0) == {1: [20, 20, 140, 100], 2: [50, 40, 90, 80]}
    desk.click(70, 60)
    assert desk.page.locator(".chosen").get_attribute("data-id") == "1"
    desk.click(70, 60)
    assert desk.page.locator(".chosen").get_attribute("data-id") == "2"
    desk.page.keyboard.down("Shift")
    desk.drag((60, 50), (80, 70))
    desk.page.keyboard.up("Shift")
    assert desk.boxes(0)[3] == [60, 50, 80, 70]


def test_the_same_thing_keeps_its_id_in_another_frame(desk: Desk) -> None:
    desk.drag((20, 20), (50, 50))
    desk.press("Enter", "Escape")
    desk.drag((100, 20), (130, 50))
    desk.press("Enter", "Escape")
    desk.go("ArrowRight", 1)
    desk.page.click("[data-object='2']")  # not here yet: the next rectangle is this one
    desk.drag((10, 60), (40, 90))
    assert desk.boxes(1) == {2: [10, 60, 40, 90]}
    desk.press("Escape")
    desk.click(35, 35)  # the dashed one: copied
    assert desk.boxes(1) == {2: [10, 60, 40, 90], 1: [19, 20, 49, 50]}
    desk.page.select_option("#which", "2")  # it was the other way round
    assert desk.boxes(1) == {1: [10, 60, 40, 90], 2: [19, 20, 49, 50]}
    desk.page.select_option("#which", "new")
    assert desk.boxes(1) == {1: [10, 60, 40, 90], 3: [19, 20, 49, 50]}


def test_opened_again_it_goes_on(desk: Desk) -> None:
    desk.go("ArrowRight", 1)
    desk.drag((20, 20), (50, 50))
    desk.page.keyboard.type("bowl")
    desk.saved()
    desk.open()
    assert desk.page.inner_text("#frame-number") == f"1 / {FRAMES - 1}"
    assert desk.page.locator("[data-id='1']").count() == 1
    assert "bowl" in desk.page.inner_text("#objects")
    desk.drag((100, 20), (130, 50))
    assert list(desk.boxes(1)) == [1, 2]


def test_zoomed_in_a_rectangle_is_drawn_to_the_pixel(desk: Desk) -> None:
    desk.page.mouse.move(*desk.at(80, 60))
    for _ in range(4):
        desk.page.mouse.wheel(0, -400)
    view = desk.page.locator("#drawing").get_attribute("data-view")
    assert float(view.split()[0]) > 10
    desk.drag((75, 55), (84, 63))
    assert desk.boxes(0) == {1: [75, 55, 84, 63]}
    shown = pixels(desk.page.locator("#board"))
    assert (np.abs(shown.astype(int) - (0, 100, 200)).max(axis=2) < 8).mean() > 0.3  # the picture fills the board
    desk.press("Enter", "f")
    view = desk.page.locator("#drawing").get_attribute("data-view")
    assert float(view.split()[0]) < 5


def test_what_is_not_saved_is_said_and_saved_later(desk: Desk) -> None:
    page = desk.page
    desk.drag((20, 20), (50, 50))
    desk.saved()
    page.route("**/keyframes", lambda route: route.abort())  # as when the program is gone
    desk.press("Enter", "4")
    page.wait_for_selector("body[data-saved='failed']")
    assert "not saved" in page.inner_text("#saved")
    page.unroute("**/keyframes")
    assert desk.saved()["frames"][0]["boxes"][0]["visible"] == 0.4


def test_a_page_that_is_outdated_overwrites_nothing(desk: Desk) -> None:
    launched = desk.page.context.browser
    other = launched.new_page()
    other.goto(desk.address)
    other.wait_for_selector("body[data-ready]")
    desk.drag((20, 20), (50, 50))
    before = desk.saved()
    other.keyboard.press("k")
    other.wait_for_selector("body[data-saved='failed']")
    assert "load this one again" in other.inner_text("#saved")
    other.close()
    assert json.loads(desk.file.read_text()) == before


def test_the_help_names_every_key(desk: Desk) -> None:
    desk.press("?")
    shown = desk.page.inner_text("#help")
    for key in ("Page Down", "C", "Del", "Ctrl + Z", "Alt + arrows", "1 … 9, 0"):
        assert key in shown
    desk.press("k")  # nothing happens behind it
    desk.press("Escape")
    assert not desk.page.is_visible("#help")
    assert not desk.file.exists()


def test_on_a_phone_the_picture_has_the_width_and_no_button_is_clipped(desk: Desk) -> None:
    desk.page.set_viewport_size({"width": 390, "height": 780})
    try:
        board = desk.page.locator("#board").bounding_box()
        assert (board["x"], board["width"]) == (0, 390)
        assert board["height"] > 780 / 3
        for button in desk.page.locator("button:visible").all():
            place = button.bounding_box()
            assert place["x"] >= 0
            assert place["x"] + place["width"] <= 390
    finally:
        desk.page.set_viewport_size(VIEWPORT)
