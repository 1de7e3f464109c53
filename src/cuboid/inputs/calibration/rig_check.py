"""Whether a fixed camera was knocked: each minute, what it sees is aligned to what it saw at the start."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, RigCamera
from cuboid.ground.geometry.se3 import angle, transform
from cuboid.inputs.calibration.rig_alignment import FEW_POINTS, REACHES_M, align
from cuboid.inputs.calibration.still_view import StillView, still_view

# Time between two checks of a camera, seconds; frames of each check.
CHECK_EVERY_S, FRAMES_PER_CHECK = 60.0, 6
# A camera was knocked if it sees the scene displaced by more than this, metres: a voxel, which moves points in the map.
KNOCKED_M = 0.01


class RigWatch:
    """Checks during a run whether the cameras of a fixed rig stand still.

    Parameters
    ----------
    ahead : bool
        Check in a thread of its own, so that no frame waits.

    Attributes
    ----------
    warnings : list of str
        A line for each camera that was knocked, so far.
    """

    def __init__(self, *, ahead: bool) -> None:
        self.warnings: list[str] = []
        self._pool = ThreadPoolExecutor(1, "cuboid-rig-watch") if ahead else None
        self._cameras: dict[str, _Watched] = {}
        self._pending: deque[Future[str | None]] = deque()

    def add(self, frame: Frame) -> None:
        """Take in the next frame of a camera of the rig."""
        assert frame.camera is not None
        camera = self._cameras.setdefault(frame.camera.name, _Watched(frame.camera))
        if camera.take(frame):
            self._check(camera)
        while self._pending and self._pending[0].done():
            self._tell(self._pending.popleft().result())

    def finish(self) -> None:
        """Check each camera once more, with its last frames, and wait for all checks."""
        for camera in self._cameras.values():
            if camera.has_new_frames:
                self._check(camera)
        while self._pending:
            self._tell(self._pending.popleft().result())
        self.close()

    def close(self) -> None:
        """End the thread; checks that have not begun are left out. `finish` calls it; after an error, call it alone."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def _check(self, camera: _Watched) -> None:
        check = camera.next_check()
        if self._pool is None:
            self._tell(check())
        else:
            self._pending.append(self._pool.submit(check))

    def _tell(self, warning: str | None) -> None:
        if warning is not None:
            self.warnings.append(warning)


class _Watched:
    """A camera with its still view at the start, and the depth of its last frames."""

    def __init__(self, camera: RigCamera) -> None:
        self._camera = camera
        # Times in seconds and depth images: the check at the end of a run, which may come any time, needs the last.
        self._frames: deque[tuple[float, Float32Array]] = deque(maxlen=FRAMES_PER_CHECK)
        self._first: StillView | None = None
        self._start_s: float | None = None
        self._due_s = -np.inf
        # Frames since the check became due; frames since the last check.
        self._since_due = self._since_check = 0
        self._knocked = False

    def take(self, frame: Frame) -> bool:
        """Keep the depth of a frame; return whether the frames of the next check are complete."""
        if self._knocked:
            self._frames.clear()
            return False
        if self._start_s is None:
            self._start_s = frame.timestamp_s
        self._frames.append((frame.timestamp_s, frame.depth_m))
        self._since_check += 1
        self._since_due += frame.timestamp_s >= self._due_s
        return self._since_due == FRAMES_PER_CHECK

    @property
    def has_new_frames(self) -> bool:
        """Whether enough frames came since the last check."""
        return self._since_check >= FRAMES_PER_CHECK and not self._knocked

    def next_check(self) -> Callable[[], str | None]:
        """Return the check of the last frames; the first check keeps what the camera sees, and finds nothing."""
        frames, start_s = list(self._frames), self._start_s or 0.0
        self._since_due = self._since_check = 0
        self._due_s = start_s + CHECK_EVERY_S * (1 + (frames[-1][0] - start_s) // CHECK_EVERY_S)

        def check() -> str | None:
            if self._knocked:
                return None
            view = self._view([depth_m for _, depth_m in frames])
            if self._first is None:
                self._first = view
                return None
            return None if view is None else self._compare(self._first, view, frames[0][0] - start_s)

        return check

    def _view(self, depths_m: list[Float32Array]) -> StillView | None:
        """Return what the frames show that stands still; None if it is too little."""
        try:
            return still_view(depths_m, self._camera.intrinsics)
        except InputError:
            return None

    def _compare(self, first: StillView, later: StillView, after_s: float) -> str | None:
        """Return a warning if the camera sees the scene displaced."""
        T = align([first, later], np.array([np.eye(4)] * 2), REACHES_M[:3], FEW_POINTS)[1]
        shift_m = float(np.median(np.linalg.norm(transform(T, later.points) - later.points, axis=1)))
        if shift_m <= KNOCKED_M:
            return None
        self._knocked = True
        return (
            f"camera {self._camera.name} was knocked: {after_s:.0f} s after its start it sees the scene "
            f"{1000 * shift_m:.0f} mm and {np.degrees(angle(T)):.1f} degrees displaced; its pose in rig.json is no "
            "longer valid"
        )
