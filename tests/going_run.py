"""A run of one object on a table, which goes on until it is ended: for tests of what follows runs."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics, RigCamera
from cuboid.ground.core.results import FrameResult, MapPoints, ObjectEvent
from cuboid.results.views.live import LiveView
from fakes import FakeTracker

CAMERA = Intrinsics(160.0, 160.0, 79.5, 59.5, 160, 120)


class TableTracker(FakeTracker):
    """One object on a table of 20 000 points."""

    def map_points(self) -> MapPoints:
        x, y = np.meshgrid(np.linspace(-0.6, 0.6, 200), np.linspace(-0.3, 0.7, 100))
        xyz = np.stack((x, y, np.full_like(x, 1.15)), axis=-1).reshape(-1, 3).astype(np.float32)
        rgb = np.full((len(xyz), 3), (180, 120, 60), np.uint8)
        label = (np.abs(xyz[:, 0]) < 0.05).astype(np.int32)
        return MapPoints(xyz, rgb, np.linspace(0, 1, len(xyz), dtype=np.float32), label)


def frame(index: int) -> Frame:
    T = np.eye(4)
    T[:3, 3] = (0.3 * np.sin(index / 20), 0.0, -0.2)
    color = np.full((120, 160, 3), (20, 160, 40), np.uint8)
    return Frame(index, index / 30, color, np.full((120, 160), 1.2, np.float32), T)


class Going:
    """A run in a thread of its own until it is ended; the cameras of a rig take turns and look apart."""

    def __init__(self, view: LiveView, cameras: Sequence[str] = ()) -> None:
        self._view, self._cameras = view, cameras
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.last = 0

    def __enter__(self) -> Going:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _run(self) -> None:
        tracker = TableTracker(CAMERA)
        while not self._ended.is_set():
            here = frame(self.last)
            if self._cameras:
                k = self.last % len(self._cameras)
                T = here.T_world_camera
                assert T is not None
                T[:3, 3] += (0.4 * k, -0.1 * k, 0.0)
                here = replace(here.at(T), camera=RigCamera(self._cameras[k], CAMERA))
            found: FrameResult = tracker.update(here)
            moved = ObjectEvent("moved", 1, np.zeros(3), np.array([0.3, 0.4, 0.0]), 1.0)
            self._view(here, replace(found, events=(moved,) if self.last == 5 else ()), tracker)
            self.last += 1
            begun_s = time.thread_time()  # the live view takes a fraction of the tracker's own time: there must be some
            while time.thread_time() - begun_s < 0.02:
                time.sleep(0)
        self._view.end(complete=True, warnings=["up is not known"])

    def end(self) -> None:
        self._ended.set()
        self._thread.join()
