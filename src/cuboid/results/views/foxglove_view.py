"""`track --foxglove`: show a run in Foxglove as it proceeds, without ROS."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.middleware.foxglove import EXTRA, FEATURE, HOST, PORT, FoxgloveServer
from cuboid.results.views.live.watch import TrackerView
from cuboid.results.views.ros_stream import OK, RosStream, StreamSettings, stamp_of

# The map has 5 MB; it is sent again after this time, seconds.
MAP_SENT_EVERY_S = 2.0
DIAGNOSE_EVERY_S = 1.0


class FoxgloveView:
    """Context manager: a server with which `track_recording` shows a run.

    Parameters
    ----------
    intrinsics : Intrinsics
    host : str
    port : int
        As in `FoxgloveServer`.
    cameras : sequence of str
        As in `RosStream`.

    Attributes
    ----------
    port : int
        Port at which it listens.

    Raises
    ------
    MissingExtraError
        foxglove-sdk or rosbags is not installed.
    InputError
        The port is in use, or the address does not belong to this machine.
    """

    def __init__(self, intrinsics: Intrinsics, host: str = HOST, port: int = PORT, cameras: Sequence[str] = ()) -> None:
        messages = RosMessages(FEATURE, EXTRA)
        self._server = FoxgloveServer(messages, host, port)
        self.port = self._server.port
        self._stream = RosStream(messages, [self._server], intrinsics, pictures=[self._server], cameras=cameras)
        self._stream.settings = StreamSettings(map_every_s=MAP_SENT_EVERY_S)
        self._frames, self._diagnosed_s = 0, float("-inf")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()

    def __call__(self, frame: Frame, result: FrameResult, tracker: TrackerView) -> None:
        """Show a used frame and its results."""
        time_ns = stamp_of(frame)
        self._stream.frame(frame, result, tracker, time_ns)
        self._frames += 1
        now_s = time.monotonic()
        if now_s - self._diagnosed_s >= DIAGNOSE_EVERY_S:
            self._diagnosed_s = now_s
            values: dict[str, object] = {"frames": self._frames, "frame": frame.index, "objects": len(tracker.objects)}
            values |= {f"{stage} ms": f"{time_ms:.1f}" for stage, time_ms in result.milliseconds.items()}
            self._stream.diagnose(OK, "tracking", values, time_ns)
