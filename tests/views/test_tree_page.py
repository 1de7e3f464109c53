"""The tree of the place on the page, in a real browser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Page

from browser import OpenPage, press_layer
from cuboid.results.files import Results
from cuboid.results.files.objects import write_objects
from cuboid.results.views.report import summarise, write_report
from made_place import thing, write_place


@pytest.fixture
def page(open_page: OpenPage, tmp_path: Path) -> Page:
    folder = write_place(tmp_path)
    found = Results(folder)
    write_objects(folder / "objects.json", found.found.with_relations(found.map_points()))
    write_report(folder / "report.html", summarise(Results(folder), None))
    return open_page(folder / "report.html")


def nested(page: Page) -> object:
    """Return the list of objects as nested lists of labels and headings."""
    return page.evaluate(
        """() => {
          const names = (list) => [...list.children].filter((item) => !item.hidden).map((item) => {
            const below = item.querySelector(":scope > ul");
            const own = item.querySelector(":scope > .object, :scope > h3");
            return [own.dataset.label || own.textContent, ...(below ? names(below) : [])];
          });
          return names(document.getElementById("objects"));
        }"""
    )


def test_objects_are_listed_under_what_they_are_on_and_in(page: Page) -> None:
    assert nested(page) == [["1"], ["2"], ["3"], ["4"], ["5"]]
    page.click('[data-arranged="place"]')
    assert nested(page) == [
        ["Surface 2, 0.50 m above the lowest", ["1", ["2"]], ["3", ["5"]]],
        ["Surface 1", ["4"]],
    ]
    assert page.inner_text('.object[data-label="2"] .how') == "in"
    assert page.locator('.object[data-label="1"] .how').count() == 0
    page.fill("#search", "mug")
    assert nested(page) == [["Surface 2, 0.50 m above the lowest", ["3", ["5"]]]]
    assert page.locator('.object[data-label="3"]').is_hidden(), "what bears it is a line, and no match"
    page.fill("#search", "")
    page.click('[data-arranged="label"]')
    assert nested(page) == [["1"], ["2"], ["3"], ["4"], ["5"]]


def test_a_card_says_what_the_object_is_to_others(page: Page) -> None:
    page.click('.object[data-label="1"]')
    card = page.locator("#card dl")
    assert "surface 2" in card.inner_text()
    card.locator("text=#2 can").click()
    assert "Object 2" in page.inner_text("#card")


def test_without_relations_there_is_no_choice(open_page: OpenPage, tmp_path: Path) -> None:
    folder = write_place(tmp_path)
    write_report(folder / "report.html", summarise(Results(folder), None))
    page = open_page(folder / "report.html")
    assert page.locator("#arranged").is_hidden()
    page.click('.object[data-label="1"]')
    assert "2 of 2" in page.inner_text("#card dl")


def test_furniture_is_drawn_on_its_own_and_counted_apart(open_page: OpenPage, tmp_path: Path) -> None:
    folder = write_place(tmp_path)
    found = Results(folder).found
    table = replace(thing(9, 0.0, 0.0, 0.0, (2.0, 2.0, 0.5), plane=0), kind="support", planes=(1,))
    furnished = replace(found, furniture=(table,)).with_relations(Results(folder).map_points())
    write_objects(folder / "objects.json", furnished)
    write_report(folder / "report.html", summarise(Results(folder), None))
    page = open_page(folder / "report.html")
    assert "5 objects" in page.inner_text("#facts")
    assert "1 piece of furniture" in page.inner_text("#facts")
    assert page.locator(".object").count() == 5, "the list is of objects"
    tag = page.locator('.tag[data-label="9"]')
    assert tag.evaluate("tag => tag.hidden") is False
    press_layer(page, "furniture")
    page.wait_for_function("document.querySelector('.tag[data-label=\"9\"]').hidden")
    page.click('[data-arranged="place"]')
    assert nested(page)[0][0] == "Surface 2, furniture #9, 0.50 m above the lowest"  # type: ignore[index]


def test_a_page_without_furniture_has_no_button_for_it(page: Page) -> None:
    assert page.locator('[data-layer="furniture"]').is_hidden()
