"""The pages of a store in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_stores import put_run, thing
from playwright.sync_api import Browser

from browser import Watched, browser
from cuboid.store.find import Filters, find
from cuboid.store.page import found_page, summary_page
from cuboid.store.place import Place
from cuboid.store.query import Tables
from cuboid.store.summary import summarise_store


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
