"""The live view without a browser: what is taken from a run, when, and what the page is told."""

from __future__ import annotations

import base64
import json
import socket
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from asked import asked
from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.frame import Frame, Intrinsics, RigCamera
from cuboid.ground.core.palette import hex_of
from cuboid.ground.core.results import MapPoints
from cuboid.results.views.live import LiveServer, LiveView
from cuboid.results.views.live.messages import PICTURE_WIDTH_PX, map_message, moment_message
from cuboid.results.views.live.server import PORTS
from cuboid.results.views.live.watch import SILENCE_S, CameraView, Moment, RateLimiter
from cuboid.results.views.serving import HOST
from fakes import INTRINSICS, FakeRecording, FakeTracker


class Run:
    """A run that takes a step when it is told to."""

    def __init__(self, view: LiveView) -> None:
        self.view = view
        self.recording = FakeRecording(1000)
        self.tracker = FakeTracker(INTRINSICS)
        self.maps = 0
        self.steps = 0
        self._map_points = self.tracker.map_points
        self.tracker.map_points = self._counted  # type: ignore[method-assign]

    def _counted(self) -> MapPoints:
        self.maps += 1
        return self._map_points()

    def step(self) -> Frame:
        frame = self.recording.read(self.steps)
        self.steps += 1
        self.view(frame, self.tracker.update(frame), self.tracker)
        return frame

    def until(self, asked: threading.Thread) -> None:
        """Step until a question is answered."""
        until_s = time.monotonic() + 10
        while asked.is_alive() and time.monotonic() < until_s:
            self.step()
            time.sleep(0.01)
        asked.join(1)
        assert not asked.is_alive()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveServer]:
    # a tracker that does nothing has no time to take a fraction of
    for fraction in ("MOMENT_FRACTION", "MAP_FRACTION"):
        monkeypatch.setattr(f"cuboid.results.views.live.watch.{fraction}", 1.0)
    # Most tests have nobody who waits for the end.
    monkeypatch.setattr("cuboid.results.views.live.watch.FAREWELL_S", 0.1)
    with LiveServer(LiveView(), "a <recording>", INTRINSICS) as found:
        yield found


def get(server: LiveServer, path: str, **headers: str) -> tuple[int, bytes]:
    status, _, content = asked(server.port, path, **headers)
    return status, content


def ask(server: LiveServer, run: Run, path: str) -> bytes:
    """Ask while the run goes on."""
    found: list[bytes] = []
    thread = threading.Thread(target=lambda: found.append(get(server, path)[1]))
    thread.start()
    run.until(thread)
    return found[0]


def unpacked(message: bytes) -> tuple[dict[str, Any], np.ndarray, np.ndarray, np.ndarray]:
    """Return header, places, looks and labels of a map's message."""
    length = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + length])
    n, at = header["count"], 4 + length
    assert at % 4 == 0  # the page reads numbers of 16 bit there
    assert len(message) == at + 12 * n
    look = np.frombuffer(message, np.uint8, 4 * n, at).reshape(n, 4)
    steps = np.frombuffer(message, "<u2", 3 * n, at + 4 * n).reshape(n, 3)
    return header, header["low"] + steps * header["step_m"], look, np.frombuffer(message, "<u2", n, at + 10 * n)


def moment_of(view: LiveView) -> Moment:
    found = view.moment_after(0, 0.0)
    assert found is not None
    return found


def test_nothing_is_taken_while_nobody_looks() -> None:
    view = LiveView()
    run = Run(view)
    for _ in range(5):
        run.step()
    assert run.maps == 0
    assert view.moment_after(0, 0.0) is None
    assert view.first_pose is not None
    np.testing.assert_array_equal(view.first_pose, np.eye(4))  # from there the page looks, whenever it comes


def test_a_moment_of_a_rig_has_the_last_picture_of_each_camera() -> None:
    run = Run(LiveView())
    K = INTRINSICS
    wide = Intrinsics(K.fx / 2, K.fy / 2, K.cx, K.cy, K.width, K.height)
    lenses = {"left": INTRINSICS, "right": wide}
    for index, (name, time_s) in enumerate((("left", 0.1), ("right", 0.2), ("left", 0.3), ("right", 0.2 + SILENCE_S))):
        frame = replace(run.recording.read(index), timestamp_s=time_s, camera=RigCamera(name, lenses[name]))
        run.view(frame, run.tracker.update(frame), run.tracker)

    def shown() -> list[dict[str, Any]]:
        run.view._take_moment()
        document = json.loads(moment_message(moment_of(run.view), INTRINSICS))
        assert (document["frame"], document["seen"]) == (frame.index, 1)
        return document["cameras"]

    left, right = shown()
    assert [(one["name"], one["ended"], one["lens"]["fx"]) for one in (left, right)] == [
        ("left", False, K.fx),
        ("right", False, K.fx / 2),
    ]
    assert (left["pose"][3], right["pose"][3]) == pytest.approx((0.02, 0.03))
    assert len(base64.b64decode(right["path"])) == 2 * 12
    assert left["picture"] != right["picture"]
    frame = replace(run.recording.read(4), timestamp_s=0.4 + SILENCE_S, camera=RigCamera("right", wide))
    run.view(frame, run.tracker.update(frame), run.tracker)
    assert [(one["name"], one["ended"]) for one in shown()] == [("left", True), ("right", False)]
    assert shown()[0] == {**left, "ended": True}  # its last picture stays


def test_a_camera_with_long_intervals_has_ended_after_three_of_them() -> None:
    run = Run(LiveView())
    times = [(name, time_s) for time_s in (0.0, 3.0) for name in ("left", "right")] + [("left", 6.0), ("left", 12.1)]
    ended = []
    for index, (name, time_s) in enumerate(times):
        frame = replace(run.recording.read(index), timestamp_s=time_s, camera=RigCamera(name, INTRINSICS))
        run.view(frame, run.tracker.update(frame), run.tracker)
        run.view._take_moment()
        ended.append([one.ended for one in moment_of(run.view).cameras])
    assert ended[-2:] == [[False, False], [False, True]]


def test_a_moment_says_what_the_tracker_knew_then(server: LiveServer) -> None:
    run = Run(server.view)
    run.step()
    moment = json.loads(ask(server, run, "/moment/0"))
    assert moment["number"] == 1
    assert moment["used"] == moment["frame"] + 1
    (camera,) = moment["cameras"]
    assert (camera["name"], camera["ended"]) == ("", False)
    assert camera["pose"][3] == pytest.approx(moment["frame"] * 0.01)
    (item,) = moment["objects"]
    assert (item["label"], item["seen"], item["color"]) == (1, True, hex_of(1))
    assert item["size"] == [0.1, 0.2, 0.3]
    assert moment["planes"][0]["extent"] == [[0, 0, 0.85], [1, 0, 0.85], [0, 1, 0.85]]
    assert moment["up"] == [0, 0, 1]
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(camera["picture"]), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (48, 64, 3)
    path = np.frombuffer(base64.b64decode(camera["path"]), "<f4").reshape(-1, 3)
    np.testing.assert_allclose(path[:, 0], 0.01 * np.arange(moment["used"]), atol=1e-6)
    assert json.loads(ask(server, run, "/moment/1"))["number"] > 1


def test_the_picture_has_the_dimensions_of_the_object_that_is_selected(server: LiveServer) -> None:
    run = Run(server.view)
    run.step()
    run.step()

    def picture(question: str) -> np.ndarray:
        moment = json.loads(ask(server, run, question))
        content = base64.b64decode(moment["cameras"][0]["picture"])
        shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        return shown.astype(int) - moment["frame"] % 256  # the frames are of one gray, which grows

    plain = picture("/moment/0")
    measured = picture("/moment/1?measured=1")
    assert np.count_nonzero(np.abs(measured - plain).max(2) > 60) > 20
    for question in ("/moment/2?measured=9", "/moment/3?measured=x"):
        assert np.count_nonzero(np.abs(picture(question) - plain).max(2) > 60) < 5


def test_a_long_path_is_told_in_few_places() -> None:
    view = LiveView()
    run = Run(view)
    for _ in range(999):
        run.step()
    run.recording = FakeRecording(5000)
    for _ in range(3500):
        run.step()
    view.map_after(0, 0.0)  # somebody looks
    view.end(complete=True)
    path = moment_of(view).cameras[0].path
    assert 500 < len(path) <= 1000
    assert path[0, 0] == 0.0
    assert path[-1, 0] == pytest.approx(44.98, abs=0.1)


def test_the_picture_of_a_large_frame_is_small(server: LiveServer) -> None:
    K = Intrinsics(1000.0, 1000.0, 640.0, 360.0, 1280, 720)
    color = np.full((720, 1280, 3), (200, 30, 30), np.uint8)
    camera = CameraView(color, np.eye(4), (), np.zeros((1, 3), np.float32))
    moment = Moment(1, 7, 8, (camera,), (), (), None, 25.0)
    content = base64.b64decode(json.loads(moment_message(moment, K))["cameras"][0]["picture"])
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (270, PICTURE_WIDTH_PX, 3)
    assert np.abs(picture[50, 200].astype(int) - (30, 30, 200)).max() < 12  # red is red


def test_a_map_comes_when_it_is_asked_for_and_only_then(server: LiveServer) -> None:
    run = Run(server.view)
    header, *_ = unpacked(ask(server, run, "/map/0"))
    assert (header["number"], run.maps) == (1, 1)
    for _ in range(5):
        run.step()
    assert run.maps == 1
    assert header["count"] == header["total"] > 0


def test_a_map_is_told_as_it_is() -> None:
    rng = np.random.default_rng(3)
    points = MapPoints(
        (rng.random((500, 3)) * 4 - 2).astype(np.float32),
        rng.integers(0, 256, (500, 3)).astype(np.uint8),
        rng.random(500).astype(np.float32),
        rng.integers(0, 400, 500).astype(np.int32),
    )
    header, places, look, label = unpacked(map_message(4, points, 0.01))
    assert (header["number"], header["count"], header["total"]) == (4, 500, 500)
    np.testing.assert_allclose(places, points.xyz, atol=0.51e-3)
    np.testing.assert_array_equal(look[:, :3], points.rgb)
    np.testing.assert_allclose(look[:, 3] / 255.0, points.heat, atol=1 / 255)
    np.testing.assert_array_equal(label, points.label)
    assert header["spacing_m"] == pytest.approx(0.01)
    thin, *_ = unpacked(map_message(5, points, 0.01, max_points=125))
    assert (thin["count"], thin["total"]) == (125, 500)
    assert thin["spacing_m"] == pytest.approx(0.02)  # a quarter of the points of a surface
    nothing = MapPoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))
    assert unpacked(map_message(1, nothing, 0.01))[0]["count"] == 0


def test_what_costs_much_is_done_rarely(monkeypatch: pytest.MonkeyPatch) -> None:
    clocks = {"monotonic": 100.0, "thread_time": 10.0}
    for name in clocks:
        monkeypatch.setattr(f"cuboid.results.views.live.watch.time.{name}", lambda name=name: clocks[name])

    def work(own_s: float, waited_s: float) -> None:
        clocks["monotonic"] += waited_s
        clocks["thread_time"] += own_s

    limiter = RateLimiter(every_s=1.0, fraction=0.02)
    assert limiter.due
    limiter.begin()
    assert not limiter.due
    work(own_s=1.0, waited_s=1.0)
    assert limiter.due  # it cost nothing
    limiter.begin()
    with limiter.charged():
        work(own_s=0.1, waited_s=0.1)
    work(own_s=4.0, waited_s=100.0)
    assert not limiter.due  # 0.1 s is 2 % of 5 s of own time, however long that takes on a busy machine
    work(own_s=1.0, waited_s=1.0)
    assert limiter.due


def test_the_end_is_told_with_the_last_of_all(server: LiveServer) -> None:
    run = Run(server.view)
    number = json.loads(ask(server, run, "/moment/0"))["number"]
    last = run.step()
    answers: list[dict[str, Any]] = []

    def follow() -> None:
        at = number
        while not answers or not answers[-1].get("ended"):
            answers.append(json.loads(get(server, f"/moment/{at}")[1]))
            at = answers[-1].get("number", at)

    thread = threading.Thread(target=follow)
    thread.start()
    server.view.end(complete=True, warnings=["depth has few readings"])
    thread.join(10)
    assert answers[-1] == {"ended": True, "complete": True, "warnings": ["depth has few readings"]}
    assert answers[-2]["frame"] == last.index


def test_an_end_that_nobody_looks_at_waits_for_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    view = LiveView()
    run = Run(view)
    run.step()
    waits: list[object] = []
    monkeypatch.setattr(view._changed, "wait_for", lambda *_: waits.append(None))
    view.end(complete=False)
    assert waits == []
    assert view.ended is False
    assert run.maps == 0


def test_only_this_machine_is_answered(server: LiveServer) -> None:
    Run(server.view).step()
    assert server.view.is_watched is False
    status, page = get(server, "/")
    assert status == 200
    assert b"a &lt;recording&gt; - cuboid" in page
    assert get(server, "/", Host="attacker.example")[0] == 403
    assert get(server, "/", Host=f"localhost:{server.port}")[0] == 200
    for path in ("/moment", "/moment/x", "/../secret", "/map/-1", "/favicon.ico"):
        assert get(server, path)[0] == 404
    address = server._server.server_address
    assert address[0] == HOST


def test_with_a_host_of_ones_own_any_local_name_is_answered() -> None:
    with LiveServer(LiveView(), "x", INTRINSICS, "0.0.0.0") as server:
        server.view.end(complete=True)
        assert get(server, "/", Host="robot.local:8765")[0] == 200
    with pytest.raises(OutputError, match=r"--live: 203\.0\.113\.1 cannot be used"):
        LiveServer(LiveView(), "x", INTRINSICS, "203.0.113.1")


def test_several_look_and_some_go(
    server: LiveServer, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    drawn: list[int] = []

    def counted(moment: Moment, intrinsics: Intrinsics, measured: int | None) -> bytes:
        drawn.append(moment.number)
        return moment_message(moment, intrinsics, measured)

    monkeypatch.setattr("cuboid.results.views.live.server.moment_message", counted)
    run = Run(server.view)
    for _ in range(5):  # they close the page before they have an answer
        with socket.create_connection((HOST, server.port)) as gone:
            gone.sendall(b"GET /map/0 HTTP/1.1\r\nHost: localhost\r\n\r\n")
            gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    slow = socket.create_connection((HOST, server.port))  # asks, and never reads
    slow.sendall(b"GET /map/0 HTTP/1.1\r\nHost: localhost\r\n\r\n")
    numbers: list[int] = []
    threads = [
        threading.Thread(target=lambda: numbers.append(json.loads(get(server, "/moment/0")[1])["number"]))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        run.until(thread)
    assert sorted(set(numbers)) == sorted(set(drawn))  # what several ask for is drawn once
    assert len(drawn) == len(set(drawn))
    slow.close()
    assert capfd.readouterr().err == ""


def test_a_second_run_takes_the_next_port(server: LiveServer) -> None:
    with LiveServer(LiveView(), "x", INTRINSICS) as other:
        assert other.port != server.port
        assert other.port in PORTS or server.port not in PORTS
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((HOST, other.port))  # it is free again
