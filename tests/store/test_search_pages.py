"""The pages of `cuboid serve` for a place and for a store, in a real browser."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from made_stores import put_run, thing
from playwright.sync_api import Browser, Page, expect

from browser import Watched, pixels, rect
from cuboid.fleet.store.asgi import application as store_application
from cuboid.fleet.store.find import find
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.results.files.naming import name_object
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.opening import open_place
from cuboid.services.queries.place import Place
from cuboid.services.queries.search_page import found_page
from cuboid.services.service.app import application
from cuboid.services.service.live import RunSource
from cuboid.services.service.updates import Update
from made_place import OBJECTS, PLANES, UP, write_place
from served import serving

Opened = Callable[..., Watched]
HOSTILE = "<script>alert(1)</script>"
SIZES = [(1280, 800), (768, 1024), (390, 844)]
REPORT = "results/kitchen/seq 1/00000000000000000001"
GROUNDS = {"dark": (12, 15, 20), "light": (243, 245, 248)}  # those of the report


def write_store(folder: Path) -> str:
    """Two kitchens and an office; one recording failed."""
    place = StoreFolder(str(folder))
    jpeg = cv2.imencode(".jpg", np.full((40, 60, 3), 90, np.uint8))[1].tobytes()
    on_table = [{"kind": "on", "label": None, "surface": name, "score": 0.9} for name in ("plane:1", "table")]
    cups = [
        thing(1, name="cup", color="red", picture=jpeg, relations=on_table, later="there", last_frame=9),
        thing(2, name="cup", longest_m=0.3, length_m=0.3, relations=[]),
        thing(3, name=HOSTILE, last_seen=None, last_frame=80),
    ]
    put_run(place, 1, cups, recording="kitchen/seq 1", results=REPORT, floating=1, brief=2, seconds=34.0)
    put_run(place, 2, [thing(1, name="cup")], recording="kitchen-2", seconds=7000.0, frames_read=20)
    put_run(place, 3, [thing(1, name="stapler")], recording="office")
    put_run(place, 4, [], recording="broken", state="failed", reason="no camera: " + "a long reason " * 8)
    place.put(f"{REPORT}/report.html", b"<!doctype html><title>a run</title>")
    return place.url


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    """A place, of which object 4 has a hostile name, and a store."""
    results = write_place(tmp_path_factory.mktemp("place"))
    name_object(results, 4, HOSTILE)
    store = write_store(tmp_path_factory.mktemp("store"))
    with ExitStack() as stack:
        place = stack.enter_context(serving(application(open_place(str(results)), token=None)))
        of_store = stack.enter_context(serving(store_application(store, token=None)))
        yield SimpleNamespace(place=place, store=of_store, url=store)


@pytest.fixture
def opened(launched: Browser) -> Iterator[Callable[..., Watched]]:
    """A function that opens a page under its own content policy."""
    pages: list[Page] = []

    def open_page(address: str, size: tuple[int, int] = SIZES[0], scheme: str = "dark") -> Watched:
        watched = Watched(launched, scheme, strict=True)
        pages.append(watched.page)
        watched.page.set_viewport_size({"width": size[0], "height": size[1]})
        watched.page.goto(address)
        return watched

    yield open_page
    for page in pages:
        page.close()


def tags(page: Page) -> list[str]:
    return page.locator(".card .chip").all_inner_texts()


def recordings(page: Page) -> list[str]:
    return page.locator(".card .whose").all_inner_texts()


def shows(page: Page, *texts: str) -> None:
    expect(page.locator(".card .chip")).to_have_text(texts)


PAGES = {
    "place": ("place", "/"),
    "a question to a place": ("place", "/?q=where+is+the+mug&color=red"),
    "nothing in a place": ("place", "/?q=the+mug&max_size=2cm&on=floor"),
    "a question that is not understood": ("place", "/?q=whatever+this+may+be"),
    "store": ("store", "/"),
    "recordings": ("store", "/recordings"),
}


@pytest.mark.parametrize("size", SIZES, ids=lambda size: str(size[0]))
@pytest.mark.parametrize("name", PAGES)
def test_it_fits_the_screen(opened: Opened, served: SimpleNamespace, name: str, size: tuple[int, int]) -> None:
    of, path = PAGES[name]
    address = getattr(served, of)
    for scheme in ("dark", "light") if size == SIZES[0] else ("dark",):  # which differ in colors alone
        watched = opened(f"{address}{path}", size, scheme)
        page = watched.page
        assert pixels(page.locator("body"))[-2, 3].tolist() == list(GROUNDS[scheme])
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        cut = page.evaluate(
            """() => [...document.querySelectorAll(".card, .about, .recordings li, .figure, #answer, .ask")]
                 .filter((one) => one.scrollWidth > one.clientWidth).map((one) => one.className)"""
        )
        assert cut == []
        boxes = [box for one in page.locator(".card").all() if (box := one.bounding_box()) is not None]
        for k, a in enumerate(boxes):  # no card covers another one
            assert a["width"] >= 180
            for b in boxes[:k]:
                apart_x = a["x"] >= b["x"] + b["width"] or b["x"] >= a["x"] + a["width"]
                assert apart_x or a["y"] >= b["y"] + b["height"] or b["y"] >= a["y"] + a["height"]
        if size[0] == 390:
            assert bottom(page, ".ask") <= size[1] / 6
            for folded in page.locator("#more, summary").all():
                folded.click()
            assert small_targets(page) == []
        assert {urlsplit(one).netloc for one in watched.requests} == {urlsplit(address).netloc}
        # a picture that does not exist, or a question with a mistake, is a status of an answer
        assert [one for one in watched.complaints if "the server responded with a status" not in one] == []


def bottom(page: Page, selector: str) -> float:
    box = rect(page.locator(selector))
    return box["y"] + box["height"]


def small_targets(page: Page) -> list[str]:
    """The targets of a finger that are lower or narrower than 44 px."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll("a[href], button, input, select, summary")]
             .filter((one) => one.checkVisibility() && !one.closest('[aria-hidden="true"]'))
             .filter((one) => one.getBoundingClientRect().height < 44 || one.getBoundingClientRect().width < 44)
             .map((one) => one.outerHTML.slice(0, 90))"""
    )
    return found


def test_a_question_gives_the_right_cards_and_an_address_to_share(opened: Opened, served: SimpleNamespace) -> None:
    watched = opened(served.place)
    page = watched.page
    shows(page, "#1 crate", "#2 can", "#3", f"#4 {HOSTILE}", "#5 mug")
    assert page.locator("#facts").inner_text() == "5 objects"
    page.keyboard.press("/")  # to the question, by keyboard alone
    page.keyboard.type("what is in the crate?")
    page.keyboard.press("Enter")
    shows(page, "#2 can")
    assert page.locator(".said").inner_text() == "Understood: in 'crate'"
    card = page.locator(".card").inner_text()
    for told in ("7.0 × 7.0 × 20.0 cm", "grey", "in #1 crate", "still there at the end", "probability 0.90"):
        assert told in card, told
    assert "last seen in frame 5 (2026-03-01 12:00:05 UTC) of recording, 0.76 m away" in card
    assert page.url.endswith("/?q=what+is+in+the+crate%3F")
    other = opened(page.url)
    shows(other.page, "#2 can")
    assert other.page.get_by_label("Question in English").input_value() == "what is in the crate?"
    page.get_by_label("Question in English").fill("the red things")
    page.get_by_role("button", name="Search").click()
    shows(page, "#5 mug")
    page.go_back()
    shows(page, "#2 can")
    assert watched.complaints == []


def test_filters_are_conditions_and_nothing_says_what_to_loosen(opened: Opened, served: SimpleNamespace) -> None:
    page = opened(served.place).page
    page.get_by_label("standing on").select_option("plane:1")
    shows(page, "#1 crate", "#3")
    assert "on a table, 0.50 m high" in page.locator(".card").first.inner_text()
    page.get_by_label("longest side from").fill("25cm")
    page.get_by_label("longest side from").press("Enter")
    shows(page, "#1 crate")
    assert page.url.endswith("?min_size=25cm&on=plane%3A1")
    assert page.locator(".pill").all_inner_texts() == [
        "longest side from 25cm ×",
        "standing on a table, 0.50 m high ×",
    ]
    page.get_by_label("color", exact=True).select_option("red")
    shows(page)
    assert page.locator(".empty").inner_text() == "No object matches: 1 object without “color red”."
    page.get_by_role("link", name="1 object").click()
    shows(page, "#1 crate")
    page.get_by_role("link", name="Remove longest side from 25cm").click()
    shows(page, "#1 crate", "#3")
    page.get_by_label("probability from").fill("0.95")
    shows(page)
    assert "2 objects without “probability from 0.95”" in page.locator(".empty").inner_text()


def test_a_mistake_is_one_line_with_the_fields_to_correct(opened: Opened, served: SimpleNamespace) -> None:
    for address, said in (
        ("?near=here", "near: expected X,Y,Z in metres, got 'here'"),
        ("?color=blue&q=the+red+mug", "color: expected one condition, got 'red' and 'blue'"),
        ("?horse=1", "unknown parameter 'horse'"),
        ("?name=%22%3E%3Cb%3Ehorse", "no object has the name '\">"),
        ("?q=where+is+the+horse", "no object has the name 'horse'; names: '<script>"),
        ("?min_size=8", "8 what? A length needs its unit: 8cm, or 8m"),
    ):
        page = opened(f"{served.place}/{address}").page
        told = page.locator("#answer").inner_text()
        assert said in told, told
        assert tags(page) == []
    page = opened(f"{served.place}/?near=here").page
    page.get_by_role("textbox", name="near, m").fill("0.3,0,0.6")
    page.get_by_role("textbox", name="near, m").press("Enter")
    expect(page.locator(".card .chip").first).to_have_text("#5 mug")


def test_an_object_is_shown_in_3d(opened: Opened, served: SimpleNamespace) -> None:
    page = opened(f"{served.place}/?name=mug").page
    page.get_by_role("link", name="Show in 3D: #5 mug").click()
    page.wait_for_url("**/report.html#5")
    expect(page.locator("#card .chip").first).to_have_text("#5 mug")


def test_a_page_follows_results_that_change(opened: Opened, tmp_path: Path) -> None:
    results = write_place(tmp_path)
    with serving(application(open_place(str(results)), token=None)) as address:
        watched = opened(f"{address}/?q=larger+than+25+cm")
        shows(watched.page, "#1 crate", "#4")
        name_object(results, 4, "parcel")
        shows(watched.page, "#1 crate", "#4 parcel")
        assert watched.complaints == []


def test_a_page_follows_a_run(opened: Opened) -> None:
    source = RunSource("a run", Pipe()[0])
    place = Place(source)

    def tell(frame: int, count: int) -> None:
        source.take(Update(frame, 1772366400.0 + frame, np.eye(4), OBJECTS[:count], (), PLANES, UP))

    tell(0, 1)
    with serving(application(place, token=None)) as address:
        watched = opened(address)
        page = watched.page
        assert page.locator("#facts").inner_text() == "running, 1 object"
        shows(page, "#1 crate")
        assert page.get_by_role("link", name="Show in 3D").count() == 0  # the results will have it
        card = page.locator(".card").first.element_handle()
        tell(5, 2)
        shows(page, "#1 crate", "#2 can")
        expect(page.locator("#facts")).to_have_text("running, 2 objects")
        assert card.evaluate(
            "(one) => one.isConnected || document.querySelector('.card').innerText.includes('frame 5')"
        )
    expect(page.locator("#facts")).to_have_text("The run has ended, or the server does not answer", timeout=15_000)


def test_the_objects_of_a_store_are_searched(opened: Opened, served: SimpleNamespace) -> None:
    watched = opened(served.store)
    page = watched.page
    assert page.locator("#facts").inner_text() == "5 objects in 3 recordings"
    page.get_by_label("Question in English").fill("red cups")
    page.get_by_role("button", name="Search").click()
    shows(page, "#1 cup")
    assert recordings(page) == ["kitchen/seq 1"]
    card = page.locator(".card")
    for told in ("10.0 × 10.0 × 10.0 cm", "red", "on a table", "still there at the end"):
        assert told in card.inner_text(), told
    link = page.get_by_role("link", name="Show in 3D: #1 cup")
    assert link.get_attribute("href") == "results/kitchen/seq%201/00000000000000000001/report.html#1"
    assert card.locator("img").evaluate("(one) => one.decode().then(() => one.naturalWidth)") == 60
    page.goto(f"{served.store}/?name=cup&max_size=20cm")
    assert sorted(recordings(page)) == ["kitchen-2", "kitchen/seq 1"]
    page.get_by_label("recording").fill("kitchen/*")
    page.get_by_label("recording").press("Enter")
    shows(page, "#1 cup")
    page.get_by_role("link", name="Similar").click()
    page.wait_for_url("**like=kitchen**")
    assert "#1 cup" not in tags(page)[:1] or recordings(page)[0] != "kitchen/seq 1"
    assert page.get_by_role("textbox", name="similar to").input_value() == "kitchen/seq 1#1"
    page.goto(f"{served.store}/?q=the+stapler&min_size=2m")
    assert page.locator(".empty").inner_text() == "No object matches: 1 object without “longest side from 200cm”."
    assert watched.complaints == []
    page.goto(f"{served.store}/results/kitchen/seq%201/00000000000000000001/report.html#1")
    assert page.title() == "a run"


def test_recordings_say_in_words_what_to_check(opened: Opened, served: SimpleNamespace) -> None:
    watched = opened(f"{served.store}/recordings")
    page = watched.page
    told = page.inner_text("main")
    for words in (
        "floating: 1 object on no surface, and touching no other object",
        "brief: 2 objects seen in fewer than five frames",
        "10 frames not used",
        "nothing to check",
        "117 min",
        "no camera: a long reason",
    ):
        assert words in told, words
    assert "hours" not in told
    page.get_by_label("Names of recordings").fill("kitchen*")
    page.get_by_role("button", name="Search").click()
    page.wait_for_url("**recording=kitchen**")
    assert sorted(page.locator(".recordings > li > span:first-child").all_inner_texts()) == [
        "kitchen-2",
        "kitchen/seq 1",
    ]
    assert watched.complaints == []
    page.get_by_role("link", name="kitchen/seq 1").click()
    assert page.title() == "a run"


def test_names_are_text(launched: Browser, served: SimpleNamespace) -> None:
    asked = "%3Cscript%3Ealert(1)%3C/script%3E"
    for address in (served.place, served.store):
        for path in (f"?name={asked}", f"?q={asked}", f"?horse={asked}&on={asked}"):
            watched = Watched(launched, strict=True)
            watched.page.on("dialog", lambda dialog: pytest.fail(dialog.message))
            watched.page.goto(f"{address}/{path}")
            assert not re.search(r"<script>\s*alert", watched.page.content())
            watched.page.close()


def test_a_file_holds_its_objects_with_their_pictures(opened: Opened, served: SimpleNamespace, tmp_path: Path) -> None:
    file = tmp_path / "found.html"
    file.write_text(found_page(find(Tables(served.url), Filters(name="cup"), ("picture",)), "Objects of a store"))
    watched = opened(file.as_uri())
    assert sorted(recordings(watched.page)) == ["kitchen-2", "kitchen/seq 1", "kitchen/seq 1"]
    assert watched.page.locator("img").evaluate("(one) => one.decode().then(() => one.naturalWidth)") == 60
    assert watched.requests == [file.as_uri()]
    assert watched.complaints == []
