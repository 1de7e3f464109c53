"""The page of many objects with names, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from browser import VIEWPORT, Watched, pixels, press_layer, settle
from cuboid.ground.core.palette import color_of, hex_of
from cuboid.inputs.readers import open_recording
from cuboid.results.files import Results
from cuboid.results.views.report import summarise, write_report
from made_crowd import box, crowd, write_crowd

COUNT = 40


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    results = write_crowd(tmp_path_factory.mktemp("crowd"), COUNT)
    write_report(
        results / "report.html", summarise(Results(results), open_recording(results.parent / "recording").read)
    )
    return results / "report.html"


@pytest.fixture(scope="module")
def opened(launched: Browser, report: Path) -> Watched:
    watched = Watched(launched)
    watched.open(report)
    return watched


@pytest.fixture
def page(opened: Watched) -> Iterator[Page]:
    """The page at its first size, with nothing chosen and nothing searched for; it must not complain."""
    opened.page.set_viewport_size(VIEWPORT)
    search(opened.page, "")
    opened.page.evaluate("document.querySelectorAll('#card:not([hidden]) .close').forEach((button) => button.click())")
    yield opened.page
    assert opened.complaints == []


def search(page: Page, text: str) -> None:
    page.fill("#search", text)
    settle(page)


def listed(page: Page) -> list[int]:
    labels = page.locator("#objects .object:visible").evaluate_all("rows => rows.map((row) => row.dataset.label)")
    return [int(label) for label in labels]


def rects(page: Page, which: str) -> list[dict[str, Any]]:
    return page.locator(which).evaluate_all(  # type: ignore[no-any-return]
        "places => places.map((place) => { const { left, top, right, bottom } = place.getBoundingClientRect();"
        " return { text: place.textContent, left, top, right, bottom }; })"
    )


def test_names_stand_beside_labels_in_list_timeline_and_scene(page: Page) -> None:
    item = next(item for item in crowd(COUNT) if item.name == "cup")
    tag = f"#{item.label} cup"
    assert page.inner_text(f'#objects [data-label="{item.label}"] .chip') == tag
    assert page.locator(f'#plot [data-row="{item.label}"] .name').evaluate("text => text.firstChild.data") == tag
    search(page, f"#{item.label}")
    assert page.locator("#tags .tag:visible").all_inner_texts() == [f"{tag} {item.probability:.2f}"]


def test_a_long_name_is_cut_and_prints_over_nothing(page: Page) -> None:
    long = next(item for item in crowd(COUNT) if item.name and len(item.name) > 20)
    row = f'#objects [data-label="{long.label}"]'
    chip, size, count = (rects(page, f"{row} {part}")[0] for part in (".chip", ".size", ".seen-count"))
    assert chip["bottom"] <= size["top"] + 1
    assert chip["right"] <= count["left"]
    assert page.locator(f"{row} .chip").get_attribute("title") == f"#{long.label} {long.name}"
    plate, number = (rects(page, f'#plot [data-row="{long.label}"] {part}')[0] for part in ("rect[rx]", ".count"))
    assert plate["right"] <= number["left"]


def test_the_list_shows_a_picture_of_each_object(page: Page) -> None:
    pictures = page.locator("#objects .thumb")
    assert pictures.count() == COUNT
    assert pictures.first.evaluate("image => image.decode().then(() => image.naturalWidth)") > 20


def test_the_card_outlines_the_object_in_its_picture(page: Page) -> None:
    page.click('#objects [data-label="5"]')
    image = rects(page, "#card .shot img")[0]
    edge = rects(page, "#card .outline .edge")[0]
    assert page.locator("#card .outline .edge").get_attribute("stroke") == hex_of(5)
    assert image["left"] < edge["left"] < edge["right"] < image["right"]
    assert image["top"] < edge["top"] < edge["bottom"] < image["bottom"]


@pytest.mark.parametrize(
    ("text", "which"),
    [
        ("cup", lambda item: item.name == "cup"),
        ("SCREWS box", lambda item: item.name == "box of screws"),
        ("#3", lambda item: item.label == 3),
        ("17", lambda item: item.label == 17),
        ("cup > 12", lambda item: item.name == "cup" and max(item.box.size) > 0.119),
        ("<9cm", lambda item: max(item.box.size) < 0.091),
    ],
)
def test_a_search_leaves_what_is_asked_for(page: Page, text: str, which: Any) -> None:
    search(page, text)
    wanted = [item.label for item in crowd(COUNT) if which(item)]
    assert wanted
    assert listed(page) == wanted
    assert page.inner_text("#object-count") == f"{len(wanted)} of {COUNT} objects"
    assert page.locator("#plot .row").count() == len(wanted)
    tags = page.locator("#tags .tag:visible").evaluate_all("tags => tags.map((tag) => Number(tag.dataset.label))")
    assert set(tags) <= set(wanted)


def test_a_search_that_finds_nothing_says_so_and_is_left_by_escape(page: Page) -> None:
    search(page, "elephant")
    assert listed(page) == []
    assert page.inner_text("#none") == "No object matches."
    page.focus("#search")
    page.keyboard.press("Escape")
    assert len(listed(page)) == COUNT


@pytest.mark.parametrize("size", [(1280, 800), (800, 900), (390, 844)])
def test_no_tag_covers_another_or_a_toolbar(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    for view in ("#look-home", "#look-down"):
        page.click(view)
        settle(page)
        tags = rects(page, "#tags .tag:visible:not(.dot)")
        assert len(tags) > 10
        bars = rects(page, "#view .bar > *")
        canvas = rects(page, "#canvas")[0]
        for i, tag in enumerate(tags):
            assert canvas["left"] <= tag["left"] < tag["right"] <= canvas["right"]
            for other in [*tags[:i], *bars]:
                apart = (
                    tag["right"] <= other["left"]
                    or other["right"] <= tag["left"]
                    or tag["bottom"] <= other["top"]
                    or other["bottom"] <= tag["top"]
                )
                assert apart, (tag, other)


def test_a_tag_has_its_name_where_there_is_room_and_when_it_is_chosen(page: Page) -> None:
    search(page, "box")
    texts = page.locator("#tags .tag:visible:not(.dot)").all_inner_texts()
    assert any("box of screws" in text for text in texts)
    search(page, "")
    short = page.locator("#tags .tag:visible").evaluate_all(
        "tags => tags.filter((tag) => !tag.textContent.startsWith(tag.title)).map((tag) => tag.dataset.label)"
    )
    assert short  # forty names are too many
    page.click(f'#objects [data-label="{short[0]}"]')
    settle(page)
    tag = page.locator(f'#tags [data-label="{short[0]}"]')
    assert tag.inner_text().startswith(tag.get_attribute("title") or "no title")


@pytest.mark.parametrize("size", [(390, 844), (360, 640), (800, 900), (844, 390)])
def test_on_a_small_screen_no_button_is_clipped_and_the_scene_has_the_most_room(
    page: Page, size: tuple[int, int]
) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    settle(page)
    buttons = rects(
        page, "header button:visible, #view .bar button:visible, #below button:visible, #transport :visible"
    )
    assert len(buttons) > 8
    for button in buttons:
        assert button["left"] >= 0, button
        assert button["right"] <= size[0], button
        assert button["bottom"] <= size[1], button
    view, panel = rects(page, "#view")[0], rects(page, "#panel")[0]

    def area(place: dict[str, Any]) -> float:
        return float((place["right"] - place["left"]) * (place["bottom"] - place["top"]))

    assert area(view) > area(panel)
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    on_phone = page.locator("#below").is_visible()
    if on_phone:
        page.click("[data-below=time]")
    slider = rects(page, "#slider")[0]
    assert slider["right"] - slider["left"] > (0.3 if on_phone else 0.4) * size[0]
    if on_phone:
        page.click("[data-below=list]")


def test_on_a_phone_list_and_timeline_take_turns(page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.locator("#objects").is_visible()
    assert not page.locator("#plot").is_visible()
    page.click("[data-below=time]")
    assert page.locator("#plot").is_visible()
    assert not page.locator("#objects").is_visible()
    page.wait_for_function("document.querySelector('#plot .seen').getBoundingClientRect().right > 0")
    last = rects(page, "#plot .seen")[0]
    assert 300 < last["right"] <= 390
    page.click("[data-below=list]")
    page.click('#objects [data-label="7"]')
    assert page.locator("#card h2").is_visible()
    page.set_viewport_size(VIEWPORT)
    assert page.locator("#plot").is_visible()
    assert not page.locator("#below").is_visible()


def test_a_list_of_figures_is_one_row_of_the_settings(page: Page) -> None:
    page.click("#tab-run")
    assert page.locator("#settings dt").all_inner_texts().count("distortion") == 1
    assert page.inner_text("#settings dt:text-is('distortion') + dd") == "0.1, -0.2, 0, 0.001, 0.05"
    page.click("#tab-scene")


def test_the_ruler_measures_between_two_points_and_the_scale_fits(page: Page) -> None:
    page.set_viewport_size({"width": 1280, "height": 800})
    page.click("#look-down")
    press_layer(page, "boxes")
    page.click("#tab-scene")
    settle(page)
    canvas = pixels(page.locator("#canvas")).astype(int)
    middles = []
    for label in (1, 7):  # the two ends of the first row
        own = np.abs(canvas - color_of(label)).max(axis=2) < 12
        assert own.sum() > 100
        middles.append(np.argwhere(own).mean(axis=0)[::-1])
    page.click("#ruler")
    for x, y in middles:
        page.locator("#canvas").click(position={"x": x, "y": y})
    settle(page)
    a, b = (box(label, COUNT) for label in (1, 7))
    apart_cm = 100 * float(np.linalg.norm((a.center + a.size * (0, 0, 0.5)) - (b.center + b.size * (0, 0, 0.5))))
    measured = page.inner_text("#ruler-label").split()
    assert measured[1] == "cm"
    assert float(measured[0]) == pytest.approx(apart_cm, abs=3.0)
    assert page.locator("#card").is_hidden()  # a click measures, and chooses nothing
    bar = rects(page, "#scale i")[0]
    shown = page.inner_text("#scale span").split()
    assert shown[1] == "cm"
    pixels_apart = float(np.linalg.norm(middles[1] - middles[0]))
    assert (bar["right"] - bar["left"]) / float(shown[0]) == pytest.approx(pixels_apart / apart_cm, rel=0.1)
    page.keyboard.press("Escape")
    settle(page)
    assert page.locator("#ruler-label").is_hidden()
    assert page.get_attribute("#ruler", "aria-pressed") == "false"
    press_layer(page, "boxes")
    page.click("#look-home")


def test_without_warnings_there_is_no_banner(page: Page) -> None:
    assert page.locator("#warnings").is_hidden()
    view, header = rects(page, "#view")[0], rects(page, "body > header")[0]
    assert view["top"] == pytest.approx(header["bottom"], abs=1)
