"""The page in a real browser: what people see, and what they can do."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from playwright.sync_api import Browser, Page

from browser import VIEWPORT, OpenPage, Watched, pixels, press_layer, rect, settle
from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import MapPoints
from cuboid.inputs.readers import open_recording
from cuboid.results.files import Results, read_tracks
from cuboid.results.files.rows import EventRow
from cuboid.results.views.report import summarise, write_report
from cuboid.results.views.report.points import pack_points
from made_results import BEST, COLORS, SEEN, SKIPPED, SPANS, write_results


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_results(tmp_path_factory.mktemp("page"), complete=False)
    read = open_recording(folder.parent / "recording").read
    write_report(folder / "report.html", summarise(Results(folder), read))
    return folder


@pytest.fixture(scope="module")
def opened(launched: Browser, results: Path) -> Watched:
    """The page, opened from disk once: starting WebGL without a graphics card takes a second."""
    found = Watched(launched)
    found.open(results / "report.html")
    return found


@pytest.fixture
def watched(opened: Watched) -> Iterator[Watched]:
    """The page as it was in the beginning; in the end it must not have complained."""
    opened.page.set_viewport_size(VIEWPORT)
    opened.page.evaluate(
        """() => {
          const click = (id) => document.getElementById(id).click();
          ["tab-scene", "all-frames"].forEach(click);
          document.querySelector('[data-coloring="color"]').click();
          const left = '[data-layer][aria-pressed="false"], #card:not([hidden]) .close';
          document.querySelectorAll(left).forEach((button) => button.click());
          click("look-home");
        }"""
    )
    settle(opened.page)
    yield opened
    assert opened.complaints == []


@pytest.fixture
def page(watched: Watched) -> Page:
    return watched.page


def near(picture: UInt8Array, color: tuple[int, int, int], tolerance: int = 24) -> int:
    """Return how many pixels have about a color."""
    return int((np.abs(picture.astype(int) - color).max(axis=2) <= tolerance).sum())


def points_of(picture: UInt8Array, label: int) -> npt.NDArray[np.bool_]:
    """Return which pixels show points of an object: one channel of its color is light, the others are dark."""
    strongest = int(np.argmax(COLORS[label]))
    others = [k for k in range(3) if k != strongest]
    found: npt.NDArray[np.bool_] = (picture[..., strongest] > 90) & (picture[..., others] < 70).all(axis=2)
    return found


def click_object(page: Page, label: int) -> None:
    """Click into the scene, on the middle of what is seen of an object."""
    canvas = page.locator("#canvas")
    y, x = np.argwhere(points_of(pixels(canvas), label)).mean(axis=0)
    canvas.click(position={"x": x, "y": y})


def move_to(page: Page, place: int) -> None:
    """Move the slider to the place of a frame among the used ones."""
    moved = "(slider, to) => { slider.value = to; slider.dispatchEvent(new Event('input')); }"
    page.locator("#slider").evaluate(moved, place)
    settle(page)


def test_it_opens_from_disk_and_asks_for_nothing_else(watched: Watched, results: Path) -> None:
    assert watched.requests == [(results / "report.html").as_uri()]


def test_the_scene_is_drawn(page: Page) -> None:
    shown = pixels(page.locator("#canvas"))
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 500
    for label in COLORS:
        assert points_of(shown, label).sum() > 100, label
        assert near(shown, color_of(label)) > 60  # tag and edges


def test_the_scene_is_drawn_for_readers_who_allow_motion_too(open_page: OpenPage, results: Path) -> None:
    shown = pixels(open_page(results / "report.html", motion=True).locator("#canvas"))
    for label in COLORS:
        assert points_of(shown, label).sum() > 100, label


def test_points_are_colored_as_asked(page: Page) -> None:
    looks = {}
    for name in ("color", "heat", "label"):
        page.click(f'[data-coloring="{name}"]')
        looks[name] = pixels(page.locator("#canvas")).astype(int)
    for a, b in (("color", "heat"), ("color", "label"), ("heat", "label")):
        assert np.abs(looks[a] - looks[b]).mean() > 0.5


def test_layers_can_be_left_out(page: Page) -> None:
    move_to(page, 37)
    page.click("#look-down")
    page.locator("#canvas").hover()
    for _ in range(5):  # the camera is outside of the view of all labels
        page.mouse.wheel(0, 300)
        settle(page)
    before = pixels(page.locator("#canvas")).astype(int)
    for name in ("planes", "camera", "boxes"):
        press_layer(page, name)
        after = pixels(page.locator("#canvas")).astype(int)
        assert np.abs(after - before).max() > 30, name
        before = after
    assert page.locator(".tag:visible").count() == 0


@pytest.mark.parametrize("way", ["tag", "box", "row", "list"])
def test_a_click_on_an_object_shows_its_card(page: Page, way: str) -> None:
    assert page.locator("#card").is_hidden()
    if way == "box":
        click_object(page, 2)
    else:
        page.click({"tag": '.tag[data-label="2"]', "row": '[data-row="2"]', "list": '.object[data-label="2"]'}[way])
    card = page.inner_text("#card")
    for text in ("Object 2", "15.0 × 15.0 × 10.0 cm", "0.30, 0.10, 0.05 m", "frame 5", "frame 39", "33 of 38", "0.70"):
        assert text in card, text
    picture = page.locator("#card .shot img")
    assert picture.evaluate("image => image.decode().then(() => image.naturalWidth)") > 20
    assert np.abs(pixels(picture)[20:-20, 20:-20].reshape(-1, 3).mean(axis=0) - (BEST[2], 100, 200)).max() < 4
    page.click("#card .close")
    assert page.locator("#card").is_hidden()


def test_what_an_object_was_called_before_is_told(page: Page) -> None:
    page.click('[data-row="1"]')
    assert "#4" in page.inner_text("#card")


@pytest.mark.parametrize("width", [1280, 390])
def test_the_slider_leaves_likely_objects(page: Page, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    assert page.locator("#objects .likely").all_inner_texts() == ["0.60", "0.70", "0.80"]
    if width < 600:
        page.click("#show")  # on a phone the colors and the slider are in the menu
    page.click('[data-coloring="label"]')
    page.keyboard.press("Escape")
    page.locator('.object[data-label="1"]').click()
    settle(page)
    before = pixels(page.locator("#canvas")).astype(int)
    if width < 600:
        page.click("#show")
    slider = page.locator("#least")
    box = rect(slider)
    assert 0 <= box["x"] < box["x"] + box["width"] <= width
    slider.focus()
    for _ in range(65):
        page.keyboard.press("ArrowRight")
    settle(page)
    assert page.inner_text("#least-value") == "0.65"
    assert page.inner_text("#frame-number") == "38 frames"  # the arrow keys moved the slider alone
    assert page.inner_text("#object-count") == "2 of 3 objects"
    assert page.locator("#objects .object:visible .chip").all_inner_texts() == ["#2", "#3"]
    assert page.locator("#plot .row").evaluate_all("rows => rows.map((row) => row.dataset.row)") == ["2", "3"]
    assert sorted(page.locator(".tag:visible").all_inner_texts()) == ["#2 0.70", "#3 0.80"]
    assert page.locator("#card").is_hidden()  # it was chosen
    shown = pixels(page.locator("#canvas")).astype(int)
    color = np.array(color_of(1))
    assert (np.abs(before - color).max(axis=2) < 24).sum() > 60
    assert (np.abs(shown - color).max(axis=2) < 24).sum() == 0  # neither box nor points
    page.keyboard.press("Home")
    assert page.locator("#objects .object:visible").count() == 3
    slider.blur()


def test_the_timeline_has_the_spans_of_the_tracks(page: Page, results: Path) -> None:
    bars = page.locator("#plot .seen").evaluate_all(
        "bars => bars.map(({dataset, x, width}) => "
        "[dataset.label, dataset.from, dataset.to, x.baseVal.value, width.baseVal.value].map(Number))"
    )
    found: dict[int, list[tuple[int, int]]] = {}
    for label, begin, end, *_ in bars:
        found.setdefault(int(label), []).append((int(begin), int(end)))
    assert found == SPANS
    rows = read_tracks(results / "tracks.csv")
    for label, runs in found.items():
        inside = {frame for begin, end in runs for frame in range(begin, end + 1)} - set(SKIPPED)
        assert inside == {row.frame for row in rows if row.label == label}
    long = max(bars, key=lambda bar: bar[4])
    per_frame = long[4] / (39 - 5)  # the last frame is the end of the plot
    for _, begin, end, x, width in bars:
        assert x - long[3] == pytest.approx(per_frame * (begin - 5), abs=0.5)
        assert width == pytest.approx(max(1.5, per_frame * (min(end + 1, 39) - begin)), abs=0.5)
    assert page.locator("#axis .skipped").count() == len(SKIPPED)


def test_a_frame_shows_what_was_known_then(page: Page) -> None:
    before = pixels(page.locator("#canvas"))
    move_to(page, 3)
    assert page.inner_text("#frame-number") == "frame 3"
    assert page.locator(".tag:visible").all_inner_texts() == ["#1 0.60"]
    move_to(page, 24)  # 7 and 23 were skipped
    assert page.inner_text("#frame-number") == "frame 26"
    assert sorted(page.locator(".tag:visible").all_inner_texts()) == ["#1 0.60", "#2 0.70"]
    assert page.locator("#objects .hidden-now .chip").all_inner_texts() == ["#1", "#3"]
    assert page.locator(".tag.faint:visible").all_inner_texts() == ["#1 0.60"]  # hidden, but known
    assert np.abs(pixels(page.locator("#canvas")).astype(int) - before).max() > 60
    page.keyboard.press("ArrowRight")
    assert page.inner_text("#frame-number") == "frame 27"
    page.keyboard.press("Escape")
    settle(page)
    assert page.inner_text("#frame-number") == "38 frames"
    assert page.locator(".tag.faint:visible").count() == 0


def test_the_card_leads_to_the_frame_of_its_picture(page: Page) -> None:
    page.click('[data-row="3"]')
    page.click("#card figcaption button")
    assert page.inner_text("#frame-number") == f"frame {BEST[3]}"


def test_a_card_has_pictures_through_time_which_lead_to_their_frames(page: Page) -> None:
    page.click('[data-row="1"]')
    shots = page.locator("#card .moment")
    numbers = [int(text) for text in shots.all_inner_texts()]
    assert numbers == sorted(numbers)
    assert len(numbers) == 6
    assert shots.first.locator("img").evaluate("image => image.decode().then(() => image.naturalWidth)") > 20
    shots.nth(3).click()
    assert page.inner_text("#frame-number") == f"frame {numbers[3]}"
    assert shots.nth(3).get_attribute("aria-current") == "true"


def test_a_ceiling_is_cut_for_an_eye_above_it_and_sizes_have_their_errors(
    open_page: OpenPage, results: Path, tmp_path: Path
) -> None:
    finished = Results(results)
    below = finished.map_points()
    x, y = np.meshgrid(np.arange(-1.5, 1.5, 0.015), np.arange(-1.5, 1.5, 0.015))
    ceiling = np.stack((x, y, np.full_like(x, 1.5)), axis=-1).reshape(-1, 3).astype(np.float32)
    gray = np.full((len(ceiling), 3), 130, np.uint8)
    none = np.zeros(len(ceiling), np.int32)
    points = MapPoints(
        np.concatenate((below.xyz, ceiling)),
        np.concatenate((below.rgb, gray)),
        np.concatenate((below.heat, none.astype(np.float32))),
        np.concatenate((below.label, none)),
    )
    summary = dataclasses.replace(summarise(finished, None), points=pack_points(points))
    sure = tuple(
        dataclasses.replace(item, size_sigma_m=(0.002, 0.001, 0.02)) if item.label == 2 else item
        for item in summary.found.objects
    )
    found = dataclasses.replace(summary, found=dataclasses.replace(summary.found, objects=sure))
    write_report(tmp_path / "report.html", found)
    page = open_page(tmp_path / "report.html")
    page.click("#look-down")
    page.locator("#canvas").hover()
    for _ in range(2):  # above the ceiling
        page.mouse.wheel(0, 300)
        settle(page)
    assert points_of(pixels(page.locator("#canvas")), 2).sum() > 100
    press_layer(page, "cut")
    settle(page)
    assert points_of(pixels(page.locator("#canvas")), 2).sum() < 20
    assert page.inner_text('.object[data-label="2"] .size') == "15.0 × 15.0 × 10"
    page.click('.object[data-label="2"]')
    assert "15.0 ± 0.4 × 15.0 ± 0.2 × 10 ± 4 cm" in page.inner_text("#card")


def test_playing_runs_through_the_frames(page: Page) -> None:
    move_to(page, 30)
    page.keyboard.press(" ")
    page.wait_for_function("document.getElementById('frame-number').textContent === 'frame 39'", timeout=10_000)
    page.wait_for_selector("#play:not(.playing)", timeout=10_000)  # a tick later


def test_the_scene_can_be_turned_moved_and_looked_at_through_the_camera(page: Page) -> None:
    seen = [pixels(page.locator("#canvas")).astype(int)]

    def changed() -> bool:
        for _ in range(20):  # a browser takes a wheel's turn in when it likes
            shown = pixels(page.locator("#canvas")).astype(int)
            if np.abs(shown - seen[-1]).mean() > 1.0:
                seen.append(shown)
                return True
            page.wait_for_timeout(100)
        return False

    for button in ("left", "right"):
        page.mouse.move(500, 300)
        page.mouse.down(button=button)
        page.mouse.move(560, 320, steps=3)
        page.mouse.up(button=button)
        assert changed(), button
    assert page.locator("#card").is_hidden()  # a drag is no click
    page.mouse.wheel(0, -300)
    assert changed()
    for name in ("look-home", "look-down", "look-through"):
        page.click(f"#{name}")
        assert changed(), name
    # the middle of the scene is what the camera looks at
    tags = {int(tag.inner_text()[1:]): tag.bounding_box() for tag in page.locator(".tag:visible").all()}
    assert tags == {}  # nothing was known in the first frame
    move_to(page, 37)
    box = page.locator('.tag[data-label="1"]').bounding_box()
    other = rect(page.locator('.tag[data-label="2"]'))
    assert box is not None
    assert box["x"] < other["x"]


def test_the_second_tab_tells_how_it_went(page: Page) -> None:
    page.click("#tab-run")
    assert page.locator("#view").is_hidden()
    rows = page.locator("#stages tbody tr").all_inner_texts()
    assert [row.split() for row in rows] == [
        ["whole", "frame", "25.0", "40.0"],
        ["decode", "5.00", "6.00"],
        ["<b>fuse", "20.0", "34.0"],
    ]
    assert page.inner_text("#skipped tbody").split(maxsplit=2) == ["2", "7", SKIPPED[7]]
    assert "0.01" in page.inner_text("#settings")
    assert "38 of 40" in page.inner_text(".figures").replace("\n", "")
    assert "not complete" in page.inner_text("#facts")
    page.click("#tab-scene")
    assert page.locator("#view").is_visible()


def test_dark_and_light_follow_the_reader(open_page: OpenPage, results: Path) -> None:
    brightness = {}
    for scheme in ("dark", "light"):
        page = open_page(results / "report.html", scheme)
        brightness[scheme] = pixels(page.locator("body")).mean()
        page.click("#theme")
        settle(page)
        brightness[f"{scheme}, turned over"] = pixels(page.locator("body")).mean()
    assert brightness["light"] > 2 * brightness["dark"]
    assert abs(brightness["dark, turned over"] - brightness["light"]) < 3


def test_it_can_be_resized(page: Page) -> None:
    for width, height in ((1920, 1080), (1024, 640)):
        page.set_viewport_size({"width": width, "height": height})
        for wanted in (
            "document.documentElement.scrollWidth <= innerWidth",
            "document.getElementById('plot').getBoundingClientRect().right <= innerWidth",
            "canvas.width === canvas.clientWidth && canvas.height === canvas.clientHeight",
        ):
            page.wait_for_function(wanted, timeout=30_000)
    before = rect(page.locator("#panel"))
    splitter = rect(page.locator('[data-size="--side"]'))
    page.mouse.move(splitter["x"], 200)
    page.mouse.down()
    page.mouse.move(splitter["x"] - 80, 200, steps=2)
    page.mouse.up()
    width = f"Math.abs(document.getElementById('panel').getBoundingClientRect().width - {before['width'] + 80}) < 3"
    page.wait_for_function(width, timeout=30_000)


def test_without_webgl_the_rest_is_shown_all_the_same(launched: Browser, results: Path) -> None:
    found = Watched(launched)
    found.page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    found.page.goto((results / "report.html").as_uri())
    assert "needs a browser with WebGL 2" in found.page.inner_text("#notice")
    found.page.click('[data-row="2"]')
    assert "Object 2" in found.page.inner_text("#card")
    assert found.page.locator("#plot .seen").count() == sum(map(len, SPANS.values()))
    assert len(SEEN) == found.page.locator("#plot .row").count()
    assert found.complaints == []
    found.page.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_warnings_are_a_banner_that_can_be_hidden(
    open_page: OpenPage, results: Path, tmp_path: Path, width: int
) -> None:
    finished = Results(results)
    warnings = (
        "the camera was lost in 30 of 100 frames; move slower",
        "a <b>long</b> line " + 12 * "that goes on and on ",
    )
    summary = summarise(finished, None)
    report = dataclasses.replace(summary.report, warnings=warnings)
    write_report(tmp_path / "report.html", dataclasses.replace(summary, report=report))
    page = open_page(tmp_path / "report.html", width=width)
    lines = page.locator("#warnings li").all_inner_texts()
    assert lines == ["The run was interrupted: these results are not complete.", warnings[0], warnings[1].strip()]
    box, view = rect(page.locator("#warnings")), rect(page.locator("#view"))
    assert box["x"] + box["width"] <= width
    assert view["y"] == pytest.approx(box["y"] + box["height"], abs=1)
    page.click("#warnings .close")
    assert page.locator("#warnings").is_hidden()


def test_events_are_signs_in_the_timeline_and_lines_of_the_card(
    open_page: OpenPage, results: Path, tmp_path: Path
) -> None:
    here, there = np.zeros(3), np.array([0.3, 0.4, 0.0])
    events = (EventRow("moved", 1, here, there, 0.9, 12, 0.4), EventRow("gone", 2, here, None, 1.0, 30, 1.0))
    write_report(tmp_path / "report.html", dataclasses.replace(summarise(Results(results), None), events=events))
    page = open_page(tmp_path / "report.html")
    signs = page.locator("[data-event]").evaluate_all(
        "signs => signs.map((one) => [one.closest('.row').dataset.row, one.dataset.event, one.textContent])"
    )
    assert signs == [
        ["1", "moved", "#1: moved 50.0 cm, reported in frame 12"],
        ["2", "gone", "#2: gone, reported in frame 30"],
    ]
    page.click('[data-event="moved"]')
    for _ in range(2):  # the second click leaves the object chosen
        assert page.inner_text("#frame-number") == "frame 12"
        card = " ".join(page.inner_text("#card").split())
        assert "Moved 50.0 cm, frame 12" in card
        page.click('[data-event="moved"]')


def test_the_address_may_name_an_object(open_page: OpenPage, results: Path) -> None:
    page = open_page(f"{(results / 'report.html').as_uri()}#2")
    assert page.locator("#card .chip").first.inner_text() == "#2"
    page.evaluate("location.hash = '#3'")
    page.wait_for_function("document.querySelector('#card .chip').innerText === '#3'")
    page.evaluate("location.hash = '#99'")  # no such object: the page stays
    assert page.locator("#card .chip").first.inner_text() == "#3"
