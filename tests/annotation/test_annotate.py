"""`cuboid annotate` without a browser: the file, who is answered, where rectangles are carried to."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from asked import asked
from browser import answering
from cuboid import cli, open_recording
from cuboid.inputs.readers import Recording
from cuboid.lab.annotation import Annotator, KeyframesFile, make_server
from cuboid.lab.annotation.propagate import propagated
from cuboid.lab.evaluation import read_keyframes
from cuboid.results.views.serving import HOST, PageServer
from fakes import write_recording

FRAMES, HEIGHT, WIDTH = 12, 120, 160
BROKEN = 7


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """A wall at 1.5 m, the camera moving 1 cm a frame to the right; one color image is broken."""
    path = write_recording(tmp_path / "recording", FRAMES, (HEIGHT, WIDTH))
    cv2.imwrite(str(path / "color" / "000003.png"), np.full((HEIGHT, WIDTH, 3), (200, 100, 30), np.uint8))
    (path / "color" / f"{BROKEN:06d}.png").write_bytes(b"none")
    return open_recording(path)


@pytest.fixture
def file(recording: Recording, tmp_path: Path) -> KeyframesFile:
    return KeyframesFile(tmp_path / "drawn.json", recording)


@pytest.fixture
def server(recording: Recording, file: KeyframesFile) -> Iterator[PageServer]:
    with make_server(Annotator(recording, file, 4)) as found, answering(found):
        yield found


def ask(
    server: PageServer, method: str, path: str, body: bytes | None = None, headers: Mapping[str, str] | None = None
) -> tuple[int, bytes]:
    status, _, content = asked(server.server_port, path, method, body, **(headers or {}))
    return status, content


def own_page(server: PageServer) -> dict[str, str]:
    return {"Content-Type": "application/json", "Origin": f"http://{HOST}:{server.server_port}"}


def send(server: PageServer, path: str, document: Any, **headers: str | None) -> tuple[int, Any]:
    given = {name: value for name, value in {**own_page(server), **headers}.items() if value is not None}
    status, content = ask(server, "POST", path, json.dumps(document).encode(), given)
    return status, json.loads(content) if status == 200 else content.decode()


def document_of(rect: list[int], frame: int = 4, **more: Any) -> dict[str, Any]:
    box = {"id": 1, "rect": rect, "visible": 0.9}
    frames = [{"frame": frame, "boxes": [box], "ignore": [[0, 0, 5, 5]]}]
    objects = [{"id": 1, "name": "mug"}]
    return {"format": "cuboid-keyframes", "version": 1, "name": "x", "objects": objects, "frames": frames, **more}


def test_what_is_sent_is_in_the_file_at_once(server: PageServer, file: KeyframesFile) -> None:
    assert not file.path.exists()  # nothing was drawn yet
    assert send(server, "/keyframes", {"revision": 0, "document": document_of([10, 20, 50, 60])}) == (
        200,
        {"revision": 1},
    )
    found = read_keyframes(file.path)
    assert [(item.id, item.name) for item in found.objects] == [(1, "mug")]
    assert (found.frames[0].frame, found.frames[0].number) == (4, 4)
    assert found.frames[0].rects_xyxy.tolist() == [[10, 20, 50, 60]]
    assert [path.name for path in file.path.parent.iterdir() if "partial" in path.name] == []


def test_drawing_goes_on_where_it_ended_and_keeps_what_others_wrote(file: KeyframesFile, recording: Recording) -> None:
    file.save(0, document_of([10, 20, 50, 60], note="drawn by hand"))
    again = KeyframesFile(file.path, recording)
    assert again.document["note"] == "drawn by hand"
    again.save(0, {**again.document, "objects": [{"id": 1, "name": "cup", "seen": "often"}]})
    written = json.loads(file.path.read_text())
    assert (written["note"], written["objects"][0]["seen"]) == ("drawn by hand", "often")


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        (document_of([10, 20, 161, 60]), "expected rectangles within 160 x 120 pixels, got [10, 20, 161, 60]"),
        (document_of([10, 20, 10, 60]), "expected a rectangle"),
        (document_of([10, 20, 50, 60], frame=12), "has frame 12"),
        (document_of([10, 20, 50, 60], format="other"), "expected format"),
        ({}, "expected format"),
    ],
)
def test_what_is_no_keyframes_is_refused_and_the_file_stays(
    server: PageServer, file: KeyframesFile, document: dict[str, Any], complaint: str
) -> None:
    send(server, "/keyframes", {"revision": 0, "document": document_of([1, 2, 3, 4])})
    before = file.path.read_bytes()
    status, reason = send(server, "/keyframes", {"revision": 1, "document": document})
    assert status == 422
    assert complaint in reason
    assert file.path.read_bytes() == before


def test_nothing_is_written_over_what_somebody_else_changed(server: PageServer, file: KeyframesFile) -> None:
    assert send(server, "/keyframes", {"revision": 0, "document": document_of([1, 2, 30, 40])})[0] == 200
    status, reason = send(server, "/keyframes", {"revision": 0, "document": document_of([5, 5, 9, 9])})
    assert (status, "another page" in reason) == (409, True)
    file.path.write_text(json.dumps(document_of([7, 7, 70, 70])))
    status, reason = send(server, "/keyframes", {"revision": 1, "document": document_of([5, 5, 9, 9])})
    assert (status, "another program" in reason) == (409, True)
    assert read_keyframes(file.path).frames[0].rects_xyxy.tolist() == [[7, 7, 70, 70]]


def test_a_full_disk_leaves_the_file_as_it_was(
    server: PageServer, file: KeyframesFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    send(server, "/keyframes", {"revision": 0, "document": document_of([1, 2, 30, 40])})
    before = file.path.read_bytes()

    def full(path: Path, document: object) -> None:
        path.write_text('{"format": "cuboid-key')
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("cuboid.lab.annotation.store.write_json", full)
    status, reason = send(server, "/keyframes", {"revision": 1, "document": document_of([5, 5, 9, 9])})
    assert (status, "the disk is full" in reason) == (422, True)
    assert file.path.read_bytes() == before
    assert [path.name for path in file.path.parent.iterdir() if "partial" in path.name] == []


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "http://somewhere.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "https://localhost:1"}, 403),
        ({"Host": "somewhere.example"}, 403),
        ({"Host": "somewhere.example", "Origin": "http://somewhere.example"}, 403),
        ({"Content-Type": "text/plain"}, 403),
        ({"Origin": None}, 403),
        *(({"Content-Length": text}, 413) for text in ("9" * 11, "0" * 10 + "9" * 10, "-1", "1e3", str(1 << 40))),
        ({"Host": "localhost:8000", "Origin": "http://localhost:8000"}, 200),  # a forwarded port
    ],
)
def test_nobody_else_s_page_can_write(
    server: PageServer, file: KeyframesFile, headers: dict[str, str | None], status: int
) -> None:
    document = {"revision": 0, "document": document_of([1, 2, 30, 40])}
    assert send(server, "/keyframes", document, **headers)[0] == status
    assert file.path.exists() == (status == 200)


@pytest.mark.parametrize("sent", [[], {}, {"revision": "x", "document": {}}, {"revision": 0, "document": 3}])
def test_nonsense_is_no_fault(server: PageServer, sent: Any) -> None:
    assert send(server, "/keyframes", sent)[0] == 400
    assert send(server, "/carry", sent)[0] == 400
    assert send(server, "/elsewhere", sent)[0] == 404


def test_frames_are_given_as_the_reader_gives_them(server: PageServer, recording: Recording) -> None:
    status, content = ask(server, "GET", "/frame/3.jpg")
    shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert status == 200
    assert shown.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(shown[..., ::-1].astype(int) - recording.read(3).color).max() < 4
    status, content = ask(server, "GET", f"/frame/{BROKEN}.jpg")
    assert (status, b"000007.png" in content) == (422, True)
    assert ask(server, "GET", f"/frame/{FRAMES}.jpg")[0] == 422
    assert ask(server, "GET", "/drawn.json")[0] == 404
    assert ask(server, "GET", "/", headers={"Origin": "http://somewhere.example"})[0] == 403


def test_rectangles_are_carried_by_poses_and_depth(server: PageServer, recording: Recording) -> None:
    # 5 cm to the right at 1.5 m, with a focal length of 160 pixels: 5.33 pixels to the left.
    asked = {"from": 0, "to": 5, "rects": [[100, 40, 130, 80], [0, 0, 6, 6]]}
    assert send(server, "/carry", asked) == (200, {"rects": [[95, 40, 125, 80], None]})
    near = [np.array(rect, np.float64) for rect in ([100, 40, 130, 80], [2, 0, 22, 20])]
    assert propagated(recording, 0, 5, near) == [(95, 40, 125, 80), (0, 0, 17, 20)]
    assert propagated(recording.without_poses(), 0, 5, near) == [(100, 40, 130, 80), (2, 0, 22, 20)]
    assert propagated(recording, BROKEN, 5, near[:1]) == [(100, 40, 130, 80)]


def call(*words: str | Path) -> int:
    return cli.main(["annotate", *map(str, words), "--no-browser"])


def test_the_command_continues_the_file_in_the_recording(
    recording: Recording, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def forever(self: PageServer) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(PageServer, "serve_forever", forever)
    assert call(recording.path) == 0
    said = " ".join(capsys.readouterr().out.split())  # lines are folded at the width of the terminal
    assert f"keyframes in {recording.path / 'keyframes.json'}, at http://localhost:" in said
    (recording.path / "keyframes.json").write_text(json.dumps(document_of([1, 2, 30, 40])))
    assert call(recording.path, "--every", "3") == 0


OF_ANOTHER = document_of([1, 2, 30, 40])
OF_ANOTHER["frames"][0]["number"] = 27


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ('{"format": "cuboid-truth"}', "expected format 'cuboid-keyframes'"),
        ("[1]", "expected an object"),
        (json.dumps(document_of([1, 2, 30, 40], frame=99)), "has frame 99, but"),
        (json.dumps(document_of([1, 2, 300, 400])), "within 160 x 120 pixels"),
        (json.dumps(OF_ANOTHER), "frame 4 is said to have the number 27"),
    ],
)
def test_a_file_of_something_else_is_one_line(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, complaint: str
) -> None:
    path = tmp_path / "other.json"
    path.write_text(content)
    assert call(recording.path, "--output", path) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert complaint in line
    assert path.read_text() == content


def test_where_nothing_can_be_written_it_is_said_at_once(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(recording.path, "--output", tmp_path / "no" / "such.json") == 2
    assert "choose another file with --output" in capsys.readouterr().err
    assert call(recording.path, "--output", tmp_path / "drawn.txt") == 2
    assert "must end with .json" in capsys.readouterr().err


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 100_000,
        b'{"revision": 1e999, "document": {}}',
        b'{"revision": 0, "document": [[1]]}',
        b'{"rects": [[1' + b"0" * 400 + b', 1, 1, 1]], "from": 0, "to": 1}',
        b'{"rects": [[1, 1, 1, 1]], "from": ' + b"9" * 30 + b', "to": 1}',
        b"\xff\xfe",
        b"",
    ],
)
@pytest.mark.parametrize("path", ["/keyframes", "/carry"])
def test_what_no_page_sends_is_refused_without_a_traceback(
    server: PageServer, capfd: pytest.CaptureFixture[str], path: str, body: bytes
) -> None:
    status, said = ask(server, "POST", path, body, own_page(server))
    assert status in (400, 422)
    assert len(said) < 300
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("target", ["http://[", "//[", "http://[::1/frame/0.jpg", "/frame/[.jpg"])
def test_an_address_that_is_not_valid_is_not_found(
    server: PageServer, capfd: pytest.CaptureFixture[str], target: str
) -> None:
    host = f"{HOST}:{server.server_port}"
    own = f"Host: {host}\r\nOrigin: http://{host}\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{{}}"
    for method in ("GET", "POST"):
        with socket.create_connection((HOST, server.server_port), timeout=20) as client:
            client.sendall(f"{method} {target} HTTP/1.0\r\n{own}".encode())
            assert client.recv(12) == b"HTTP/1.0 404", method
    assert capfd.readouterr().err == ""


def test_more_rectangles_than_a_frame_can_have_are_refused(server: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*args: object) -> None:
        raise AssertionError("must not be called")

    monkeypatch.setattr("cuboid.lab.annotation.server.propagated", never)
    rects = [[100, 40, 130, 80]] * 200_000
    found = send(server, "/carry", {"from": 0, "to": 5, "rects": rects})
    assert found == (413, "expected at most 1000 rectangles, got 200000")


@pytest.mark.parametrize(
    "rect", [[-1e308, 0, 1e308, 20], [float("nan")] * 4, [0, 0, float("inf"), 5], [0, 0, 161, 5], [9, 0, 5, 5]]
)
@pytest.mark.filterwarnings("error")
def test_rectangles_outside_the_picture_are_refused_without_a_warning(
    server: PageServer, capfd: pytest.CaptureFixture[str], rect: list[float]
) -> None:
    status, said = send(server, "/carry", {"from": 0, "to": 5, "rects": [rect]})
    assert (status, "expected rectangles within 160 x 120 pixels" in said) == (400, True)
    assert capfd.readouterr().err == ""
