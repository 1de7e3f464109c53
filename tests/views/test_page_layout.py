"""The layout of all pages at three widths, measured in a real browser.

`CUBOID_SCREENSHOTS=DIR` keeps the screenshots.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from browser import Watched, answering, pixels, rect, settle
from cuboid.inputs.readers import open_recording
from cuboid.lab.annotation import Annotator, KeyframesFile
from cuboid.lab.annotation import make_server as annotation_server
from cuboid.results.files import Results
from cuboid.results.views.live import LiveServer, LiveView
from cuboid.results.views.replay import Replay
from cuboid.results.views.report import summarise, write_report
from cuboid.results.views.report.server import Viewer
from cuboid.results.views.report.server import make_server as view_server
from cuboid.results.views.serving import PageServer
from going_run import CAMERA, Going
from made_crowd import write_crowd

COUNT = 12
PAGES = ("report", "view", "live", "annotate")
DESKTOP, TABLET, PHONE = (1280, 800), (768, 1024), (390, 844)
SIZES = (DESKTOP, TABLET, PHONE)
# A finger hits a target of this size, pixels (WCAG 2.2, success criterion 2.5.5).
TARGET_PX = 44
# Rows of controls that keep their place on the page.
CONTROLS = "body > header, .float.bar, #below, #way, .live #search"

MEASURE = """() => {
  const shown = (one) => one.checkVisibility({ checkVisibilityCSS: true }) && one.getBoundingClientRect().width > 0;
  const rect = (one) => {
    const { left, top, right, bottom, width, height } = one.getBoundingClientRect();
    return { name: one.id || one.className || one.textContent, left, top, right, bottom, width, height };
  };
  const all = (which) => [...document.querySelectorAll(which)].filter(shown);
  return {
    width: document.documentElement.scrollWidth,
    // a tag in the scene is no target of its own: its box is one, and its row in the list
    targets: all("button:not(.tag), input, select, .splitter").map(rect),
    controls: all(CONTROLS).map(rect),
    sideways: all("*").filter((one) => one.scrollWidth > one.clientWidth + 1 && !one.matches(".scrolls") &&
      ["auto", "scroll"].includes(getComputedStyle(one).overflowX)).map((one) => one.id || one.className),
    view: all("#view").map(rect)[0],
    tags: all(".tag:not(.furniture)").map((tag) => ({ ...rect(tag), dot: tag.matches(".dot") })),
  };
}""".replace("CONTROLS", repr(CONTROLS))


def serve(stack: ExitStack, server: PageServer) -> str:
    """Return the address of a server that answers until the end of the tests."""
    stack.enter_context(server)
    stack.enter_context(answering(server))
    return f"http://localhost:{server.server_port}/"


@pytest.fixture(scope="module")
def opened(launched: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Watched]]:
    """Each page, opened once."""
    results = write_crowd(tmp_path_factory.mktemp("layout"), COUNT)
    recording = open_recording(results.parent / "recording")
    write_report(results / "report.html", summarise(Results(results), recording.read))
    with ExitStack() as stack:
        live = stack.enter_context(LiveServer(LiveView(), "table", CAMERA))
        run = stack.enter_context(Going(live.view))
        keyframes = KeyframesFile(results.parent / "keyframes.json", recording)
        addresses: dict[str, str | Path] = {
            "report": results / "report.html",
            "view": serve(stack, view_server(Viewer(results, Replay(results), recording))),
            "live": f"http://localhost:{live.port}/",
            "annotate": serve(stack, annotation_server(Annotator(recording, keyframes, 4))),
        }
        found = {name: Watched(launched) for name in addresses}
        for name, address in addresses.items():
            found[name].open(address)
        found["live"].page.wait_for_selector(".tag")
        run.end()  # the page keeps the last moment
        yield found
        for watched in found.values():
            watched.page.close()


def resize(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.wait_for_function(
        f"innerWidth === {size[0]} && (document.querySelector('#view, #board').clientWidth <= {size[0]})"
    )
    settle(page)
    if page.locator("#look-home").count():
        page.click("#look-home")
    settle(page)


def measured(page: Page) -> dict[str, Any]:
    return page.evaluate(MEASURE)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Shown:
    """A page at one size, and what was measured there."""

    name: str
    size: tuple[int, int]
    page: Page
    found: dict[str, Any]


@pytest.fixture(scope="module")
def shown(request: pytest.FixtureRequest, opened: dict[str, Watched]) -> Shown:
    name, size = request.param
    page = opened[name].page
    resize(page, size)
    return Shown(name, size, page, measured(page))


def at_all_sizes(*names: str) -> pytest.MarkDecorator:
    """Run a test with these pages at all sizes; all tests of a page at a size follow each other."""
    pairs = [(name, size) for name in names for size in SIZES]
    ids = [f"{name}-{size[0]}" for name, size in pairs]
    return pytest.mark.parametrize("shown", pairs, ids=ids, indirect=True, scope="module")


@at_all_sizes(*PAGES)
def test_nothing_overflows_and_fingers_hit(shown: Shown, opened: dict[str, Watched], tmp_path: Path) -> None:
    name, size, page, found = shown.name, shown.size, shown.page, shown.found
    assert found["width"] <= size[0]
    assert found["sideways"] == []
    for target in found["targets"]:
        assert target["left"] >= 0, target
        assert target["right"] <= size[0] + 1, target
    if size == PHONE:
        assert [one for one in found["targets"] if one["height"] < TARGET_PX or one["width"] < TARGET_PX] == []
        assert sum(one["height"] for one in found["controls"]) <= size[1] / 6, found["controls"]
    kept = Path(os.environ.get("CUBOID_SCREENSHOTS") or tmp_path)
    page.screenshot(path=kept / f"{name}-{size[0]}.png")
    assert len(np.unique(pixels(page.locator("body")).reshape(-1, 3), axis=0)) > 60
    assert opened[name].complaints == []


@at_all_sizes("report", "view")
def test_all_labels_show_at_the_start(shown: Shown) -> None:
    tags, view = shown.found["tags"], shown.found["view"]
    assert len(tags) == COUNT
    for tag in tags:
        assert not tag["dot"], tag
        assert view["left"] <= tag["left"] < tag["right"] <= view["right"], tag
        assert view["top"] <= tag["top"] < tag["bottom"] <= view["bottom"], tag


@at_all_sizes("report")
def test_the_tables_of_the_second_tab_fit(shown: Shown) -> None:
    page = shown.page
    page.click("#tab-run")
    try:
        found = measured(page)
        assert found["width"] <= shown.size[0]
        assert found["sideways"] == []
    finally:
        page.click("#tab-scene")


@at_all_sizes("view", "live")
def test_the_picture_fills_its_part(shown: Shown) -> None:
    page = shown.page
    part, image = (rect(page.locator(which)) for which in ("#picture", "#picture .framed img"))
    assert image["width"] == pytest.approx(part["width"], abs=2)
    assert image["height"] == pytest.approx(part["height"], abs=2)
    ratio = page.locator("#picture .framed img").evaluate("image => image.naturalWidth / image.naturalHeight")
    assert image["width"] / image["height"] == pytest.approx(ratio, rel=0.01)


@pytest.mark.parametrize(("name", "size"), [("report", DESKTOP), ("view", TABLET), ("live", DESKTOP), ("live", PHONE)])
def test_a_divider_is_dragged_moved_by_keys_and_kept(
    opened: dict[str, Watched], name: str, size: tuple[int, int]
) -> None:
    page = opened[name].page
    resize(page, size)
    which, part, axis = (".level", "#panel", "height") if size == PHONE else (".upright", "#side", "width")
    bar = page.locator(f".splitter{which}")

    def length() -> float:
        return float(rect(page.locator(part))[axis])  # type: ignore[literal-required]

    first, place = length(), rect(bar)
    x, y = place["x"] + place["width"] / 2, place["y"] + place["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 40, y - 40, steps=2)
    page.mouse.up()
    assert length() == pytest.approx(first + 40, abs=2)
    page.keyboard.press("ArrowUp" if size == PHONE else "ArrowLeft")
    assert length() == pytest.approx(first + 56, abs=2)
    assert bar.get_attribute("aria-valuenow") == f"{length():.0f}"
    if name != "live":  # its run has ended
        page.reload()
        page.wait_for_selector("body[data-ready]")
        assert length() == pytest.approx(first + 56, abs=2)
    bar.dblclick()
    assert length() == pytest.approx(first, abs=2)


def test_rows_that_are_cut_are_counted(opened: dict[str, Watched]) -> None:
    page = opened["report"].page
    resize(page, (1280, 640))
    for part, rows in (("#panel", ".object"), ("#rows", ".row")):
        cut = page.locator(part).evaluate(
            "(part, rows) => [...part.querySelectorAll(rows)].filter((row) => row.getBoundingClientRect().bottom >"
            " part.getBoundingClientRect().bottom + 1).length",
            rows,
        )
        assert cut > 0
        assert page.inner_text(f"{part} .more") == f"{cut} more ↓"
        page.locator(part).evaluate("part => part.scrollTo(0, part.scrollHeight)")
        page.locator(f"{part} .more").wait_for(state="hidden")
    resize(page, (1280, 1400))
    assert page.locator("#panel .more").is_hidden()


def test_the_menu_is_closed_by_escape_and_by_a_click_elsewhere(opened: dict[str, Watched]) -> None:
    page = opened["report"].page
    resize(page, DESKTOP)
    menu = page.locator("#show-menu")
    for close in (lambda: page.keyboard.press("Escape"), lambda: page.mouse.click(500, 400)):
        page.click("#show")
        assert menu.is_visible()
        assert "dashed: hidden" in menu.inner_text()  # it is the legend of the lines too
        close()
        menu.wait_for(state="hidden")
    assert page.inner_text("#legend") == "seen\nhidden, still in the map"
