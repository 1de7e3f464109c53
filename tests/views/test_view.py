"""`cuboid view`: what the server gives, and to whom."""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from http.server import ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser

from asked import asked
from browser import OpenPage, Watched, answering, pixels, rect
from called import run_command
from cuboid.cli import serving, view
from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.inputs.readers import open_recording
from cuboid.method.text_search import Embeddings, TextModel
from cuboid.results.files import Results
from cuboid.results.views.replay import Replay
from cuboid.results.views.report import summarise, write_report
from cuboid.results.views.report.server import Viewer, make_server
from cuboid.results.views.serving import HOST
from made_results import FRAMES, HEIGHT, SKIPPED, WIDTH, write_results
from made_text_models import made_text_model

STRIP_PX = 24


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_results(tmp_path_factory.mktemp("view"))


@pytest.fixture(scope="module")
def server(results: Path) -> Iterator[ThreadingHTTPServer]:
    viewer = Viewer(results, Replay(results), open_recording(results.parent / "recording"))
    with make_server(viewer) as found, answering(found):
        yield found


def picture(server: ThreadingHTTPServer, frame: int, query: str = "") -> UInt8Array:
    status, kind, content = asked(server.server_port, f"/frame/{frame}.jpg{query}")
    assert (status, kind) == (200, "image/jpeg")
    shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(shown[..., ::-1], np.uint8)


def test_each_used_frame_has_its_picture(server: ThreadingHTTPServer) -> None:
    for frame in (0, 8, FRAMES - 1):
        shown = picture(server, frame)
        assert shown.shape == (HEIGHT, WIDTH, 3)
        assert np.abs(np.median(shown[:-STRIP_PX].reshape(-1, 3), axis=0) - (frame, 100, 200)).max() <= 4


def test_objects_are_drawn_into_it(server: ThreadingHTTPServer) -> None:
    def drawn(frame: int) -> int:
        changed = np.abs(picture(server, frame)[:-STRIP_PX].astype(int) - (frame, 100, 200)).max(axis=2)
        return int((changed > 40).sum())

    assert drawn(0) == 0
    assert drawn(39) > 200


def test_objects_below_a_probability_are_left_out_of_it(server: ThreadingHTTPServer) -> None:
    everything, likely, nothing = (picture(server, 39, query).astype(int) for query in ("", "?least=0.65", "?least=1"))
    plain = np.abs(nothing[:-STRIP_PX] - (39, 100, 200)).max(axis=2) > 40
    assert not plain.any()
    changed = np.abs(everything - likely)[:-STRIP_PX].max(axis=2) > 40
    assert 50 < changed.sum() < (np.abs(everything - nothing)[:-STRIP_PX].max(axis=2) > 40).sum()


def test_it_shows_what_is_asked_for(server: ThreadingHTTPServer) -> None:
    looks = [
        picture(server, 39, f"?what={what}").astype(int) for what in ("boxes", "heat", "depth", "proposals", "planes")
    ]
    for i, a in enumerate(looks):
        for b in looks[i + 1 :]:
            assert np.abs(a - b)[:-STRIP_PX].max() > 60


@pytest.mark.parametrize(
    "path",
    [
        f"/frame/{min(SKIPPED)}.jpg",
        "/frame/999.jpg",
        "/frame/1.jpg?what=secrets",
        "/frame/x.jpg",
        "/frame/1.jpg?least=much",
        "/run.json",
        "/../run.json",
    ],
)
def test_nothing_else_is_given(server: ThreadingHTTPServer, path: str) -> None:
    assert asked(server.server_port, path)[0] == 404


def test_only_this_machine_is_answered(server: ThreadingHTTPServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    for name, status in (("localhost:1234", 200), ("127.0.0.1", 200), ("somewhere.example", 403), ("", 403)):
        assert asked(server.server_port, "/", Host=name)[0] == status, name


def test_a_port_that_is_taken_is_one_line(server: ThreadingHTTPServer, results: Path) -> None:
    with pytest.raises(OutputError, match=f"port {server.server_port} cannot be used"):
        run_command(view, results, "--port", str(server.server_port), "--no-browser")
    with pytest.raises(argparse.ArgumentTypeError, match="expected a port"):
        serving.port("70000")


def test_another_recording_or_no_results_is_one_line(results: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder with the results"):
        run_command(view, tmp_path / "nothing", "--no-browser")
    (tmp_path / "note.cuboid").write_text("no scene")
    with pytest.raises(InputError, match=r"note\.cuboid"):
        run_command(view, tmp_path / "note.cuboid", "--no-browser")
    moved = tmp_path / "moved"
    shutil.copytree(results, moved)
    with pytest.raises(InputError, match="recording"):
        run_command(view, moved, "--no-browser", "--recording", tmp_path / "elsewhere")
    lines = (moved / "trajectory.txt").read_text().splitlines()
    (moved / "trajectory.txt").write_text("".join(f"9{line}\n" for line in lines))
    with pytest.raises(InputError, match=r"no frame of .* is in its trajectory"):
        run_command(view, moved, "--no-browser")


def test_the_command_says_where_and_ends_with_ctrl_c(results: Path) -> None:
    command = [sys.executable, "-m", "cuboid", "view", str(results), "--no-browser"]
    begun = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=begun) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"http://localhost:(\d+)/", line)
        assert found, line
        assert asked(int(found[1]), "/")[0] == 200
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (0, "ended\n", "")


def test_image_and_map_are_side_by_side_and_one_slider_moves_both(
    launched: Browser, server: ThreadingHTTPServer
) -> None:
    watched = Watched(launched)
    page = watched.page
    watched.open(f"http://localhost:{server.server_port}/")
    assert page.inner_text("#frame-number") == "frame 35"  # the first that shows all three objects
    image, canvas = page.locator("#frame-picture"), page.locator("#canvas")
    right, left = rect(image), rect(canvas)
    assert left["x"] + left["width"] <= right["x"] + 1
    before = pixels(canvas).astype(int)
    page.locator("#slider").focus()
    page.keyboard.press("Home")
    page.wait_for_function("document.getElementById('frame-picture').src.endsWith('/frame/0.jpg?what=boxes')")
    image.evaluate("image => image.decode()")
    middle = pixels(image)
    middle = middle[middle.shape[0] // 2, middle.shape[1] // 2]
    assert np.abs(middle.astype(int) - (0, 100, 200)).max() < 8
    assert np.abs(pixels(canvas) - before).max() > 60  # the boxes are not known yet, the camera is elsewhere
    page.keyboard.press("End")
    page.click('.object[data-label="2"]')
    outline = rect(page.locator("#frame-outline .edge"))
    shown = rect(image)
    assert shown is not None
    assert shown["x"] <= outline["x"] < outline["x"] + outline["width"] <= shown["x"] + shown["width"]
    assert outline["width"] > 10
    page.click("#card .close")
    with page.expect_response(lambda answer: "what=depth" in answer.url) as asked:
        page.click('[data-kind="depth"]')
    assert asked.value.ok
    assert watched.complaints == []
    assert {address.split("/frame/")[0].rstrip("/") for address in watched.requests} == {
        f"http://localhost:{server.server_port}"
    }


NAMED = (200, '{"name": "milk <b>carton", "name_score": null, "names": []}')
UNNAMED = (200, '{"name": "", "name_score": null, "names": []}')


def post(server: ThreadingHTTPServer, path: str, content: object) -> tuple[int, str]:
    head = {"Content_Type": "application/json", "Origin": f"http://{HOST}:{server.server_port}"}
    status, _, said = asked(server.server_port, path, "POST", json.dumps(content).encode(), **head)
    return status, said.decode()


@pytest.fixture
def own_results(results: Path, tmp_path: Path) -> Path:
    """Results that a test may change, with their page."""
    folder = tmp_path / "results"
    shutil.copytree(results, folder)
    write_report(folder / "report.html", summarise(Results(folder), None))
    return folder


@pytest.fixture
def own_server(own_results: Path) -> Iterator[ThreadingHTTPServer]:
    replay = Replay(own_results)
    with make_server(Viewer(own_results, replay, replay.recording)) as found, answering(found):
        yield found


def test_a_name_is_kept_in_the_results_and_their_page(own_server: ThreadingHTTPServer, own_results: Path) -> None:
    before = json.loads((own_results / "objects.json").read_bytes())
    assert post(own_server, "/names", {"label": 2, "name": " milk <b>carton "}) == NAMED
    assert [item.name for item in Results(own_results).found.objects] == [None, "milk <b>carton", None]
    page = (own_results / "report.html").read_text()
    assert '"name":"milk \\u003cb>carton"' in page
    assert '"name":"milk \\u003cb>carton"' in asked(own_server.server_port, "/")[2].decode()
    assert post(own_server, "/names", {"label": 2, "name": ""}) == UNNAMED
    assert json.loads((own_results / "objects.json").read_bytes()) == before


@pytest.mark.parametrize(
    ("sent", "status", "line"),
    [
        ({"label": 9, "name": "a"}, 422, "no object has the label 9"),
        ({"label": 1, "name": "a\nb"}, 422, "a name is one line of at most 100 characters"),
        ({"label": 1, "name": "a" * 101}, 422, "a name is one line of at most 100 characters"),
        ({"label": "x"}, 400, "the page and the program have different versions"),
        ([], 400, "the page and the program have different versions"),
    ],
)
def test_what_is_no_name_changes_nothing(
    own_server: ThreadingHTTPServer, own_results: Path, sent: object, status: int, line: str
) -> None:
    before = (own_results / "objects.json").read_bytes()
    answered, said = post(own_server, "/names", sent)
    assert (answered, line in said, "\n" in said) == (status, True, False)
    assert post(own_server, "/elsewhere", sent)[0] == 404
    assert (own_results / "objects.json").read_bytes() == before


def test_a_name_is_given_in_the_page(launched: Browser, own_server: ThreadingHTTPServer, own_results: Path) -> None:
    watched = Watched(launched)  # it complains of the name that is refused
    page = watched.page
    watched.open(f"http://localhost:{own_server.server_port}/")
    page.click('.object[data-label="2"]')
    with page.expect_response(lambda answer: "names=1" in answer.url):  # the picture with the name in it
        page.fill("#name", "milk carton")
        page.keyboard.press("Enter")
    page.wait_for_function("document.querySelector('.object[data-label=\"2\"] .chip').textContent === '#2 milk carton'")
    for place in ("#card .chip", '#tags [data-label="2"]'):
        assert page.locator(place).get_attribute("title") == "#2 milk carton"
    assert page.locator('#plot [data-row="2"] .name').evaluate("text => text.textContent").startswith("#2 milk")
    assert Results(own_results).found.objects[1].name == "milk carton"
    assert page.input_value("#name") == "milk carton"
    page.click('.object[data-label="1"]')
    assert page.input_value("#name") == ""
    page.fill("#name", "cup")
    (own_results / "objects.json").unlink()
    page.keyboard.press("Enter")
    page.wait_for_selector("#card .note.bad:visible")
    assert "objects.json" in page.inner_text("#card .note")
    assert page.inner_text("#card .chip") == "#1"
    page.close()


def test_without_its_given_name_an_object_has_its_class_again(open_page: OpenPage, own_results: Path) -> None:
    document = json.loads((own_results / "objects.json").read_text())
    document["objects"][1] |= {"name": "bottle", "name_score": 0.87, "names": [["can", 0.1]]}
    (own_results / "objects.json").write_text(json.dumps(document))
    replay = Replay(own_results)
    viewer = Viewer(own_results, replay, replay.recording)
    with make_server(viewer) as server, answering(server):
        page = open_page(f"http://localhost:{server.server_port}/")
        page.click('.object[data-label="2"]')
        assert page.inner_text("#card .chip") == "#2 bottle"
        card = page.inner_text("#card dl")
        assert "bottle, 87 %" in card
        assert "can, 10 %" in card
        for name, shown in (("my mug", "#2 my mug"), ("", "#2 bottle")):
            page.fill("#name", name)
            page.keyboard.press("Enter")
            page.wait_for_function(f"document.querySelector('#card .chip').textContent === '{shown}'")
        assert page.input_value("#name") == "bottle"
        assert "bottle, 87 %" in page.inner_text("#card dl")
        page.goto("about:blank")  # it asks the server for nothing more
    found = Results(own_results).found.objects[1]
    assert (found.name, found.name_score) == ("bottle", 0.87)


def test_a_text_ranks_the_list(open_page: OpenPage, own_results: Path, tmp_path: Path) -> None:
    pytest.importorskip("tokenizers")
    model = TextModel(made_text_model(tmp_path / "model"))
    vectors = {k: model.query(text).vector for k, text in ((1, "red"), (2, "green"), (3, "blue"))}
    (own_results / "embeddings.npz").write_bytes(Embeddings(model.identity, vectors).content())
    results, replay = Results(own_results), Replay(own_results)
    viewer = Viewer(own_results, replay, replay.recording, find=partial(results.find, model=model))
    with make_server(viewer) as server, answering(server):
        status, said = post(server, "/text", {"text": "blue"})
        assert (status, json.loads(said)["objects"][0]) == (200, [3, pytest.approx(1.0, abs=1e-3)])
        assert post(server, "/text", {"text": " "})[0] == 422
        assert post(server, "/text", {"no": 1})[0] == 400
        page = open_page(f"http://localhost:{server.server_port}/")

        def rows() -> list[str]:
            found: list[str] = page.evaluate(
                "[...document.querySelectorAll('.object')].map((row) => row.dataset.label)"
            )
            return found

        assert rows() == ["1", "2", "3"]
        page.fill("#search", "a blue mug")
        page.keyboard.press("Enter")
        page.wait_for_function("document.getElementById('last-column').textContent === 'fit'")
        assert rows()[0] == "3"
        assert page.locator(".object:visible").count() == 3
        assert float(page.locator(".object .seen-count").first.inner_text()) > 0.9
        page.click('.object[data-label="3"]')
        assert page.inner_text("#card .chip") == "#3"
        page.fill("#search", "#2")  # a search again
        assert page.inner_text("#last-column") == "frames"
        assert rows() == ["1", "2", "3"]
        assert page.locator(".object:visible").count() == 1
        page.goto("about:blank")
