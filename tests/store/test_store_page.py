"""The pages of a store in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_stores import put_run, thing
from playwright.sync_api import Browser, Page

from browser import Watched, browser
from cuboid.fleet.store.find import find
from cuboid.fleet.store.page import found_page, summary_page
from cuboid.fleet.store.place import Place
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.summary import summarise_store
from cuboid.services.queries.filters import Filters
from served import served


@pytest.fixture(scope="module")
def launched() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both pages, as `cuboid serve` gives them."""
    folder = tmp_path_factory.mktemp("store")
    place = Place(str(folder / "store"))
    jpeg = cv2.imencode(".jpg", np.full((40, 60, 3), 90, np.uint8))[1].tobytes()
    put_run(place, 1, [thing(k, picture=jpeg) for k in range(1, 9)], recording="kitchen-of-a-long-name")
    put_run(place, 2, [], recording="broken", state="failed", reason="no camera: " + "a long reason " * 8)
    tables = Tables(place.url)
    summary = summary_page(summarise_store(tables, 500), "the store", {"Recordings": "", "Objects": "objects"})
    objects = found_page(find(tables, Filters(), pictures=True), "Objects", {"Recordings": ".", "Objects": ""})
    (folder / "summary.html").write_text(summary)
    (folder / "objects.html").write_text(objects)
    return folder


@pytest.mark.parametrize("name", ["summary", "objects"])
@pytest.mark.parametrize("width", [1280, 390])
def test_they_look_like_the_other_pages(launched: Browser, folder: Path, name: str, width: int) -> None:
    grounds = []
    for scheme in ("dark", "light"):
        watched = Watched(launched, scheme, strict=True)
        watched.page.set_viewport_size({"width": width, "height": 640})
        watched.page.goto((folder / f"{name}.html").as_uri())
        assert watched.page.locator("header .mark").is_visible()
        assert watched.page.locator("nav [aria-current]").inner_text() == {"summary": "Recordings"}.get(name, "Objects")
        grounds.append(watched.page.evaluate("getComputedStyle(document.body).backgroundColor"))
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= width
        assert watched.page.locator('link[rel="icon"]').get_attribute("href") == "data:,"
        assert watched.requests == [(folder / f"{name}.html").as_uri()]
        assert watched.complaints == []
        watched.page.close()
    assert grounds == ["rgb(12, 15, 20)", "rgb(243, 245, 248)"]  # those of the report


@pytest.fixture(scope="module")
def kitchens(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Two kitchens and an office, served."""
    place = Place(str(tmp_path_factory.mktemp("searched")))
    cups = [thing(1, name="cup", color="red"), thing(2, name="cup", longest_m=0.3), thing(3, name='a "wide" <b>bowl')]
    put_run(place, 1, cups, recording="kitchen-1")
    put_run(place, 2, [thing(1, name="cup")], recording="kitchen-2")
    put_run(place, 3, [thing(1, name="stapler")], recording="office")
    with served(place.url) as address:
        yield address


def objects_of(page: Page) -> list[str]:
    return sorted(page.locator("tbody td:first-child").all_inner_texts())


def test_objects_are_searched_in_the_page(launched: Browser, kitchens: str) -> None:
    watched = Watched(launched, strict=True)  # the page's own policy must let the form through
    page = watched.page
    page.goto(f"{kitchens}/objects")
    assert len(objects_of(page)) == 5
    page.get_by_label("name").fill("cup")
    page.get_by_label("longest side to").fill("20cm")
    page.get_by_role("button", name="Search").click()
    page.wait_for_url("**max_size=20cm**")
    assert objects_of(page) == ["kitchen-1#1 cup", "kitchen-2#1 cup"]
    assert page.locator("h2").inner_text() == "2 objects"
    assert page.get_by_label("name").input_value() == "cup"  # the next search begins with this one
    page.get_by_label("color").select_option("red")
    page.get_by_label("recording").fill("kitchen*")
    page.get_by_label("recording").press("Enter")
    page.wait_for_url("**color=red**")
    assert objects_of(page) == ["kitchen-1#1 cup"]
    page.get_by_role("link", name="similar").click()
    page.wait_for_url("**like=kitchen-1**")
    assert objects_of(page)[0] != "kitchen-1#1 cup"
    assert page.get_by_label("similar to").input_value() == "kitchen-1#1"
    page.get_by_role("link", name="Clear").click()
    page.wait_for_url(f"{kitchens}/objects")
    assert len(objects_of(page)) == 5
    assert watched.complaints == []
    page.close()


def test_a_search_that_finds_nothing_or_cannot_be_understood_says_so(launched: Browser, kitchens: str) -> None:
    watched = Watched(launched, strict=True)
    page = watched.page
    page.goto(f"{kitchens}/objects?name=%22%3E%3Cb%3Ehorse")
    assert page.locator(".empty").inner_text() == "No object matches."
    assert page.get_by_label("name").input_value() == '"><b>horse'
    page.get_by_text("More conditions").click()
    page.get_by_label("near, m").fill("here")
    page.get_by_role("button", name="Search").click()
    page.wait_for_url("**near=here**")
    assert page.get_by_role("alert").inner_text() == "near: expected X,Y,Z in metres, got 'here'"
    assert page.get_by_label("near, m").is_visible()  # to be corrected, with the rest as it was
    assert page.get_by_label("name").input_value() == '"><b>horse'
    page.close()


def test_recordings_are_searched_by_name(launched: Browser, kitchens: str) -> None:
    watched = Watched(launched, strict=True)
    page = watched.page
    page.goto(kitchens)
    assert len(objects_of(page)) == 3
    page.get_by_label("recording").fill("kitchen*")
    page.get_by_role("button", name="Search").click()
    page.wait_for_url("**recording=kitchen**")
    assert objects_of(page) == ["kitchen-1", "kitchen-2"]
    assert page.locator(".figure strong").first.inner_text() == "2"
    assert watched.complaints == []
    page.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_the_search_fits_the_screen(launched: Browser, kitchens: str, width: int) -> None:
    watched = Watched(launched, strict=True)
    watched.page.set_viewport_size({"width": width, "height": 640})
    for address in (f"{kitchens}/objects?since=400d", kitchens):
        watched.page.goto(address)
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= width
        for box in (one.bounding_box() for one in watched.page.locator("input, select, button").all()):
            assert box is not None
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width
    watched.page.close()
