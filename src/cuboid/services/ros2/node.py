"""The node: it receives images, tracks, and publishes the objects, until a signal or the end of the images."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import closing, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult
from cuboid.ground.formats.rig_file import FIXED
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.middleware.transport import Inlet, Qos, Services, Transport
from cuboid.inputs.calibration.rig_check import RigWatch
from cuboid.inputs.cameras.live import LiveCamera
from cuboid.inputs.cameras.live_rig import LiveRig
from cuboid.inputs.cameras.ros2 import RosCamera
from cuboid.method.heatmap.row_memory import resident_mb
from cuboid.results.views.ros_stream import OK, STALE, WARN, RosStream
from cuboid.services.ros2.commands import Answer, AnyCommand, Reset, answer
from cuboid.services.ros2.parameters import Parameters
from cuboid.services.ros2.services import NodeServices
from cuboid.services.ros2.session import Session

CLOCK, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"
# Interval of the diagnostics, seconds; after SILENT_S seconds without an image, the node is reported as stale.
DIAGNOSE_EVERY_S, SILENT_S = 1.0, 2.0
# Number of latest frames from which the reported median and 99th percentile of latency are computed.
FRAMES_KEPT = 300
# Figures that count losses between the arrival of an image and its detections.
LOSSES = ("frames skipped", "frames dropped", "images without partner", "images damaged")


class NodeClock:
    """The clock of the node: the clock of the machine, or simulated time.

    Parameters
    ----------
    messages : RosMessages
    inlet : Inlet or None
        The topic /clock if time is simulated, else None.
    """

    def __init__(self, messages: RosMessages, inlet: Inlet | None) -> None:
        self._messages, self._inlet = messages, inlet
        self._simulated_ns = 0

    def __call__(self) -> int:
        """Return the current time, nanoseconds; 0 before the first message of a simulated clock."""
        if self._inlet is None:
            return time.time_ns()
        while (data := self._inlet.take()) is not None:
            stamp = self._messages.decode(data, CLOCK_TYPE).clock
            self._simulated_ns = stamp.sec * 10**9 + stamp.nanosec
        return self._simulated_ns

    @classmethod
    def of(cls, transport: Transport, messages: RosMessages, *, simulated: bool) -> NodeClock:
        """Return the clock of a node on a transport."""
        inlet = transport.inlet(CLOCK, CLOCK_TYPE, Qos.SENSOR, 1, wakes=False) if simulated else None
        return cls(messages, inlet)


class RosNode:
    """A tracker with images from topics and results on topics.

    Parameters
    ----------
    cameras : mapping of str to RosCamera
        The cameras by their names in the rig; a single camera has the name "".
    live : LiveCamera or LiveRig
        The frames of the cameras.
    session : Session
    stream : RosStream
    clock : NodeClock
    """

    def __init__(
        self,
        cameras: Mapping[str, RosCamera],
        live: LiveCamera | LiveRig,
        session: Session,
        stream: RosStream,
        clock: NodeClock,
    ) -> None:
        self._cameras, self._live, self._session, self._stream, self._now_ns = cameras, live, session, stream, clock
        fixed = isinstance(live, LiveRig) and live.rig.kind == FIXED
        self._watch = RigWatch(ahead=True) if fixed else None
        self.parameters = Parameters(partial(setattr, stream, "settings"))
        self._services: NodeServices | None = None
        self._latency_ms: deque[float] = deque(maxlen=FRAMES_KEPT)
        self._frame_ms: deque[float] = deque(maxlen=FRAMES_KEPT)
        self._last_frame_s = self._diagnosed_s = time.monotonic()
        self._lost = 0
        stream.names = session.names
        live.idle = self.between_frames

    def serve(self, messages: RosMessages, transport: Transport, carriers: Sequence[Services], node: str) -> None:
        """Offer the services and the topics of commands."""
        self._services = NodeServices(messages, transport, carriers, self._stream, node, self._answered, self._now_ns)

    def run(self, limit: int | None = None) -> None:
        """Track until the camera is closed, or until `limit` frames were processed."""
        with nullcontext() if self._watch is None else closing(self._watch):
            for count, frame in enumerate(self._live, start=1):
                self._track(frame)
                self.between_frames()
                if count == limit:
                    break
            if self._watch is not None:
                self._watch.finish()

    def between_frames(self) -> None:
        """Answer requests and commands, and send diagnostics once a second."""
        if self._services is not None:
            self._services.run()
        if time.monotonic() - self._diagnosed_s >= DIAGNOSE_EVERY_S:
            self._diagnosed_s = time.monotonic()
            self._stream.diagnose(*self._state(), self._now_ns())

    def finish(self) -> Path | None:
        """Write the results at the end, see `Session.finish`; return their folder."""
        return self._session.finish()

    @property
    def warnings(self) -> list[str]:
        """Problems so far, one line each: of the cameras, and fixed cameras that were knocked."""
        return [*self._live.warnings, *([] if self._watch is None else self._watch.warnings)]

    def figures(self) -> dict[str, Any]:
        """Return the counts and times of the run so far, by name."""
        cameras, session = self._cameras.values(), self._session
        return {
            "color images": sum(camera.received["color"] for camera in cameras),
            "depth images": sum(camera.received["depth"] for camera in cameras),
            "pairs": sum(camera.paired for camera in cameras),
            "pairs without pose": sum(camera.unposed for camera in cameras),
            "frames": session.used,
            "frames skipped": session.skipped,
            "frames dropped": self._live.dropped,
            "images without partner": sum(camera.unpaired for camera in cameras),
            "images damaged": sum(camera.damaged for camera in cameras),
            "objects": len(session.tracker.objects),
            "frame ms median": _percentile(self._frame_ms, 50),
            "latency ms median": _percentile(self._latency_ms, 50),
            "latency ms p99": _percentile(self._latency_ms, 99),
            "memory MB": round(resident_mb() or 0.0, 1),
        }

    def _track(self, frame: Frame) -> None:
        begun_s = time.perf_counter()
        camera = self._cameras[frame.camera_name]
        live = self._live
        stamp_ns = camera.stamp_ns(live.camera_time_s if isinstance(live, LiveRig) else frame.timestamp_s)
        if self._watch is not None:
            self._watch.add(frame)
        result = self._session.take(frame)
        self._stream.camera, self._stream.world = camera.frame_id, camera.world or self._stream.world
        if isinstance(result, FrameResult):
            self._stream.frame(frame, result, self._session.tracker, stamp_ns)
        self._frame_ms.append((time.perf_counter() - begun_s) * 1e3)
        self._latency_ms.append((self._now_ns() - stamp_ns) / 1e6)
        self._last_frame_s = time.monotonic()

    def _answered(self, command: AnyCommand) -> Answer:
        if isinstance(command, Reset):
            self._stream.clear(self._now_ns())
        return answer(command, self._session, self.parameters)

    def _state(self) -> tuple[int, str, Mapping[str, object]]:
        """Return level, message and figures of the diagnostics."""
        figures = self.figures()
        lost = sum(count for name, count in figures.items() if name in LOSSES)
        new, self._lost = lost - self._lost, lost
        silent_s = time.monotonic() - self._last_frame_s
        if silent_s > SILENT_S:
            return STALE, f"no image for {silent_s:.0f} s", figures
        if self.warnings:
            return WARN, self.warnings[-1], figures
        if new:
            return WARN, f"{new} frames lost in the last second", figures
        return OK, "tracking", figures


def _percentile(values: Sequence[float] | deque[float], percent: float) -> float:
    return round(float(np.percentile(list(values), percent)), 1) if values else 0.0
