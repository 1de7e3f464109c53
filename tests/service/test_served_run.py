"""A run that answers while it goes: from another process, which it never waits for."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult, MapPoints, ObjectEvent, Sighting, TrackedObject
from cuboid.results.views.serving import LOCAL_NAMES
from cuboid.services.service.process import ServedRun
from made_place import OBJECTS, PLANES, UP

CLIENTS = 50


class Running:
    """A tracker whose map is what a test says."""

    def __init__(self) -> None:
        self.objects: list[TrackedObject] = list(OBJECTS[:2])
        self.planes, self.up = list(PLANES), UP
        self.config, self.points_known, self.map_bytes = TrackerConfig(), 0, 0
        self.frames = 0

    def map_points(self) -> MapPoints:
        label = np.array([0, 1, 1, 2], np.int32)
        return MapPoints(np.ones((4, 3), np.float32), np.zeros((4, 3), np.uint8), np.zeros(4, np.float32), label)

    def step(self, run: ServedRun) -> None:
        """Let the run look at the next frame."""
        color = np.full((48, 64, 3), 90, np.uint8)
        frame = Frame(self.frames, 1772366400.0 + self.frames, color, np.ones((48, 64), np.float32), np.eye(4))
        rect = np.array([10.0, 10.0, 30.0, 30.0])
        seen = tuple(Sighting(item.label, item.box, None, 0.9, rect) for item in self.objects)
        heat = np.zeros((1, 1), np.float32)
        run(frame, FrameResult(self.frames, frame.timestamp_s, np.eye(4), seen, (), 0, heat, {}), self)
        self.frames += 1


@pytest.fixture
def run() -> Iterator[SimpleNamespace]:
    listening = socket.create_server(("127.0.0.1", 0))
    port = listening.getsockname()[1]
    with ServedRun("made", listening, None, LOCAL_NAMES) as served:
        yield SimpleNamespace(served=served, port=port, tracker=Running(), address=f"http://127.0.0.1:{port}")


def ask(run: SimpleNamespace, question: str = "") -> Any:
    with urlopen(f"{run.address}/api{question}", timeout=60) as answer:
        return json.loads(answer.read())


def step_until(run: SimpleNamespace, met: Any) -> None:
    """Let the run go on until something holds."""
    until_s = time.monotonic() + 60.0
    while not met():
        assert time.monotonic() < until_s
        run.tracker.step(run.served)
        time.sleep(0.01)


def test_the_map_is_told_as_it_grows(run: SimpleNamespace) -> None:
    step_until(run, lambda: ask(run)["objects"] == 2)
    run.tracker.objects = [*OBJECTS[:2], replace(OBJECTS[2], name="book")]
    step_until(run, lambda: ask(run)["objects"] == 3)
    about = ask(run)
    assert (about["title"], about["kind"], about["running"], about["up"]) == ("made", "run", True, [0.0, 0.0, 1.0])
    (book,) = ask(run, "/objects?name=book")
    assert book["center_m"] == pytest.approx([0.3, 0.0, 0.515])
    assert book["last_seen"]["time"].startswith("2026-03-01T12:00:")
    assert [one["label"] for one in ask(run, "/objects?in=crate")] == [2]
    assert ask(run, "/objects/1/history")["count"] >= 1
    with urlopen(f"{run.address}/api/objects/1/picture", timeout=60) as answer:
        assert answer.read()[:2] == b"\xff\xd8"


def test_a_search_by_text_says_that_it_needs_the_end_of_the_run(run: SimpleNamespace) -> None:
    step_until(run, lambda: ask(run)["objects"] == 2)
    with pytest.raises(HTTPError) as error:
        urlopen(f"{run.address}/api/objects?text=cup", timeout=60)
    with error.value as answer:
        assert (answer.code, "embedded at the end of a run" in json.load(answer)["error"]) == (400, True)


def test_a_cloud_is_given_between_two_frames(run: SimpleNamespace) -> None:
    step_until(run, lambda: ask(run)["objects"] == 2)
    found: list[bytes] = []

    def fetch() -> None:
        with urlopen(f"{run.address}/api/objects/1/cloud", timeout=60) as answer:
            found.append(answer.read())

    thread = threading.Thread(target=fetch)
    thread.start()
    step_until(run, lambda: bool(found))
    thread.join()
    assert b"element vertex 2\n" in found[0]


def test_fifty_clients_hear_of_each_change_and_slow_ones_are_left_behind(run: SimpleNamespace) -> None:
    async def clients() -> tuple[list[list[tuple[str, int]]], list[int | None]]:
        await asyncio.to_thread(step_until, run, lambda: ask(run)["changes"] == 2)  # both are confirmed
        where = f"ws://127.0.0.1:{run.port}/api/changes/live"
        sockets = [await connect(where, open_timeout=60) for _ in range(CLIENTS)]
        asleep = [await connect(where, open_timeout=60) for _ in range(3)]  # these never read
        run.served.feed.add_events([ObjectEvent("back", 1, None, np.zeros(3), 0.9)])
        run.tracker.objects = [OBJECTS[0], OBJECTS[2]]
        await asyncio.to_thread(step_until, run, lambda: ask(run)["changes"] == 5)
        heard = []
        for one in sockets:
            messages = [json.loads(await asyncio.wait_for(one.recv(), 60)) for _ in range(3)]
            heard.append(sorted((m["change"], m["label"]) for m in messages))
            await one.close()
        run.served.feed.end(60.0)
        codes: list[int | None] = []
        for one in asleep:
            with suppress(ConnectionClosed):
                while True:
                    await asyncio.wait_for(one.recv(), 60)
            codes.append(one.close_code)
        return heard, codes

    heard, codes = asyncio.run(clients())
    assert heard == [[("back", 1), ("confirmed", 3), ("gone", 2)]] * CLIENTS
    assert codes == [1012] * 3, "the run has ended"


def test_a_run_goes_on_while_the_answering_process_stands_still(run: SimpleNamespace) -> None:
    step_until(run, lambda: ask(run)["objects"] == 2)
    os.kill(run.served.pid, signal.SIGSTOP)
    try:
        many = [replace(OBJECTS[0], label=label, name="x" * 1000) for label in range(1, 400)]
        for k in range(300):  # each would be more than a pipe holds
            run.tracker.objects = [replace(item, frames_seen=k, last_frame=k) for item in many]
            run.tracker.step(run.served)
    finally:
        os.kill(run.served.pid, signal.SIGCONT)
    step_until(run, lambda: ask(run)["objects"] == 399)


def test_a_run_goes_on_when_the_answering_process_is_killed(run: SimpleNamespace) -> None:
    step_until(run, lambda: ask(run)["objects"] == 2)
    os.kill(run.served.pid, signal.SIGKILL)
    for _ in range(100):
        run.tracker.step(run.served)
        time.sleep(0.002)
