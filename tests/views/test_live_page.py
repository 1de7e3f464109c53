"""The live page in a real browser, while a run goes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from browser import VIEWPORT, Watched, pixels
from cuboid.cli import main
from cuboid.results.views.live import LiveServer, LiveView
from fakes import FakeTracker, write_recording
from going_run import CAMERA, Going


@pytest.fixture(scope="module")
def watched(launched: Browser) -> Watched:
    return Watched(launched)


def shares_of_scene(watched: Watched) -> tuple[float, float]:
    """Return the shares of the scene's pixels that have the table's color, and the picture's."""
    scene = pixels(watched.page.locator("#canvas")).astype(int)
    brown = (np.abs(scene - (180, 120, 60)).max(axis=2) < 40).mean()
    green = (scene[..., 1] - np.maximum(scene[..., 0], scene[..., 2]) > 60).mean()
    return float(brown), float(green)


def test_the_page_follows_a_run_to_its_end(watched: Watched) -> None:
    page = watched.page
    with LiveServer(LiveView(), "table", CAMERA) as server, Going(server.view) as run:
        watched.open(f"http://localhost:{server.port}/")
        page.wait_for_selector("body[data-frame]")
        before = int(page.locator("body").get_attribute("data-frame") or 0)
        page.wait_for_function(f"Number(document.body.dataset.frame) > {before + 10}")
        assert page.locator("h1").inner_text() == "table"
        facts = page.locator("#facts").inner_text()
        assert "1 seen / 1 known" in facts
        assert "20,000 points" in facts
        assert page.locator("#tags .tag").inner_text() == "#1 0.90"
        row = page.locator("#objects .object .chip, #objects .object .size")
        assert row.all_inner_texts() == ["#1", "10.0 × 20.0 × 30.0"]
        assert page.locator("#events li").all_inner_texts() == ["#1\nmoved 50.0 cm\nframe 5"]
        assert page.locator("#objects .likely").inner_text() == "0.90"
        with page.expect_request("**/moment/*?measured=1"):  # the picture gets the dimensions of the selected object
            page.locator("#objects .object").click()
        page.locator("#objects .object").click()
        set_least = "(slider, to) => { slider.value = to; slider.dispatchEvent(new Event('input')); }"
        page.locator("#least").evaluate(set_least, 0.95)
        page.wait_for_function("!document.querySelector('#objects .object') && document.querySelector('.tag').hidden")
        page.locator("#least").evaluate(set_least, 0)
        brown, green = shares_of_scene(watched)
        assert brown < 0.05  # the made camera is below the table, which is cut for an eye above it
        page.keyboard.press("x")
        for _ in range(20):
            brown, green = shares_of_scene(watched)
            if brown > 0.05:
                break
            page.wait_for_timeout(200)
        assert brown > 0.05  # the table
        for _ in range(20):  # the camera may have left the view, which then follows it
            if green > 0.001:
                break
            page.wait_for_timeout(200)
            green = shares_of_scene(watched)[1]
        assert green > 0.001  # the picture in the camera's pyramid
        picture = pixels(page.locator("#picture"))
        assert (picture[..., 1].astype(int) - picture[..., 0] > 60).mean() > 0.2
        page.click("[data-coloring=label]")
        page.click("#look-through")
        page.wait_for_function("document.getElementById('look-through').getAttribute('aria-pressed') === 'true'")
        page.set_viewport_size({"width": 390, "height": 780})  # a phone
        # all at once, since the list is made anew with every moment; tags follow with the next picture
        page.wait_for_function(
            "[...document.querySelectorAll('button')].map((one) => one.getBoundingClientRect())"
            ".filter(({width}) => width).every(({left, right}) => 0 <= left && right <= 390)"
        )
        page.locator("#objects .object").wait_for()
        page.locator("#scale").wait_for()
        page.locator("#notice").wait_for(state="hidden")  # it would cover the scale bar
        page.set_viewport_size(VIEWPORT)
        run.end()
        page.wait_for_selector("body[data-ended]")
        assert "the run is complete" in page.locator("#facts").inner_text()
        assert page.locator("#warnings li").all_inner_texts() == ["up is not known"]
        assert int(page.locator("body").get_attribute("data-frame") or 0) == run.last - 1
    assert watched.complaints == []
    assert all(address.startswith(f"http://localhost:{server.port}/") for address in watched.requests)


def test_the_pictures_of_all_cameras_of_a_rig_are_side_by_side(watched: Watched) -> None:
    page, names = watched.page, ["left", "middle", "right"]
    with LiveServer(LiveView(), "table", CAMERA) as server, Going(server.view, names):
        watched.open(f"http://localhost:{server.port}/")
        tiles = page.locator("#picture.several .framed")
        tiles.nth(2).wait_for()
        assert tiles.all_inner_texts() == names
        left, middle, right = [one.bounding_box() or {} for one in tiles.all()]
        assert (left["y"], left["width"]) == (middle["y"], pytest.approx(middle["width"], abs=1.0))
        assert middle["x"] >= left["x"] + left["width"]
        assert right["y"] >= left["y"] + left["height"]
        for one in tiles.all():
            picture = pixels(one)
            assert (picture[..., 1].astype(int) - picture[..., 0] > 60).mean() > 0.6
        tiles.nth(1).click()  # enlarged, and the eye can look through this camera
        page.locator("#picture .framed:nth-child(2)[aria-pressed=true]").wait_for()
        assert (tiles.nth(1).bounding_box() or {})["width"] > 1.9 * middle["width"]
        page.click("#look-through")
        page.set_viewport_size({"width": 400, "height": 800})
        page.wait_for_function("document.querySelector('#picture').getBoundingClientRect().right <= 400")
        assert page.locator("#view").bounding_box()["height"] > 150  # type: ignore[index]
        page.set_viewport_size(VIEWPORT)
    assert watched.complaints == []


def test_a_page_whose_program_is_gone_waits_for_the_next_run(watched: Watched) -> None:
    page = watched.page
    with LiveServer(LiveView(), "table", CAMERA) as server, Going(server.view):
        watched.open(f"http://localhost:{server.port}/")
        page.route("**/*", lambda route: route.abort())  # as when a forwarded port is closed
        page.wait_for_selector("body[data-lost]", timeout=20_000)
        assert "no answer" in page.locator("#facts").inner_text()
        page.unroute("**/*")
        page.wait_for_selector("body[data-frame]:not([data-lost])", timeout=20_000)


def test_track_says_where_it_can_be_seen(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cuboid.runs.pipeline.run._tracker", FakeTracker)
    recording = write_recording(tmp_path / "recording", 4)
    words = ["track", str(recording), "--output", str(tmp_path / "out")]
    assert main([*words, "--live"]) == 0
    assert "cuboid: live at http://localhost:87" in capfd.readouterr().err
    assert main([*words, "--force", "--live-host", "0.0.0.0"]) == 2
    assert "give --live too" in capfd.readouterr().err
