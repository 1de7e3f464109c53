"""Given poses of a loop or a live camera, whose clock is measured in the first seconds and corrected from then on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.pose_stream import PoseStream
from cuboid.ground.geometry.se3 import exp, inverse, log, tidied
from cuboid.method.poses.clock import PoseOffset, pose_offset_of
from cuboid.method.poses.motions import found_motions, telling_frames
from cuboid.method.poses.pyramid import Level, SmallImage, keep, shrink
from cuboid.method.poses.sources import GivenPoses, Posed, given_pose

# The clock is measured from this time of frames, seconds; of each tenth of a second one image is kept, 0.2 MB.
MEASURED_S, KEPT_EVERY_S = 10.0, 0.09
# Frames of this time, seconds, are corrected by one motion of the map: an offset changes slowly within it.
ANCHOR_S = 0.2
# Poses of the last seconds are kept for interpolation: the largest offset fits in.
STREAM_S = 1.0
# Velocity for the time after the last pose is the mean over this time, seconds.
VELOCITY_S = 0.07


class SynchronisedPoses(GivenPoses):
    """The poses that come with frames, corrected once their clock is known.

    Poses after the correction are interpolated between those of frames; where poses are late, the motion since the
    last one is extrapolated at constant velocity. Poses of frames before it are corrected as in a loop closure.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of the frames.

    Attributes
    ----------
    found : PoseOffset or None
        The measured offset; None until it is known.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._intrinsics = intrinsics
        self._times_s: list[float] = []
        self._poses: list[Float64Array] = []
        self._indices: list[int] = []
        self._images: dict[int, SmallImage] = {}  # by position in the lists
        self._trajectory: dict[int, Float64Array] = {}
        self._anchor = 0
        self._anchor_s = -np.inf
        self._anchors: list[int] = []
        self.found: PoseOffset | None = None

    @property
    def added_s(self) -> float:
        """What is added to the times of the poses, seconds."""
        return 0.0 if self.found is None or self.found.doubt else self.found.offset_s

    def locate(self, frame: Frame) -> Posed:
        """Return the pose of the frame; raises FrameError if it has none."""
        given, time_s = given_pose(frame), frame.timestamp_s
        if self._times_s and time_s <= self._times_s[-1]:
            self._begin_anew()
        self._times_s.append(time_s)
        self._poses.append(given)
        moved: dict[int, Float64Array] = {}
        if self.found is None:
            self._keep(frame)
            if time_s - self._times_s[0] >= MEASURED_S:
                moved = self._measured()
        elif time_s - self._times_s[0] > 2.0 * STREAM_S:
            first = int(np.searchsorted(self._times_s, time_s - STREAM_S))
            del self._times_s[:first], self._poses[:first]
        T_world_camera = given if not self.added_s else self._at(time_s - self.added_s)
        self._trajectory[frame.index] = T_world_camera
        return Posed(T_world_camera, self._anchor, moved)

    def trajectory(self) -> Mapping[int, Float64Array] | None:  # type: ignore[override]
        """Return the corrected poses of all frames; None if no clock was corrected."""
        return self._trajectory if self.added_s else None

    def warnings(self) -> tuple[str, ...]:
        """Return the correction, if there is one."""
        if self.found is None or self.found.doubt:
            return ()
        return (f"the times of the given poses are {self.found.text}; they are corrected",)

    def _begin_anew(self) -> None:
        """Forget the frames so far: their times repeat or go back."""
        self._times_s, self._poses, self._indices, self._anchors, self._images = [], [], [], [], {}

    def _keep(self, frame: Frame) -> None:
        """Keep what the measurement needs of a frame."""
        if frame.timestamp_s - self._anchor_s >= ANCHOR_S or frame.timestamp_s < self._anchor_s:
            self._anchor, self._anchor_s = self._anchor + 1, frame.timestamp_s
        self._indices.append(frame.index)
        self._anchors.append(self._anchor)
        position = len(self._times_s) - 1
        last = next(reversed(self._images), None)
        if last is None or frame.timestamp_s - self._times_s[last] >= KEPT_EVERY_S:
            self._images[position] = keep(*shrink(frame, self._intrinsics))

    def _measured(self) -> dict[int, Float64Array]:
        """Measure the clock; return the motion of the map around each anchor, T_new_old, if it is corrected."""
        times_s, poses, positions = np.array(self._times_s), np.array(self._poses), np.array(list(self._images))
        seen = times_s[positions], poses[positions]
        motions = found_motions(self._levels, positions.tolist(), *seen, telling_frames(*seen))
        self.found = pose_offset_of(times_s, poses, motions)
        moved = self._correct_earlier() if self.added_s else {}
        indices = self._indices
        self._images.clear()
        self._indices, self._anchors = [], []
        if self.found is None:  # the camera moved too little: measure the next seconds
            del self._times_s[:-1], self._poses[:-1]
            self._indices, self._anchors = indices[-1:], [self._anchor]
        return moved

    def _levels(self, position: int) -> tuple[Level, ...]:
        return self._images[position].levels()

    def _correct_earlier(self) -> dict[int, Float64Array]:
        """Correct the poses of the frames so far; return the motion around the middle frame of each anchor."""
        moved: dict[int, Float64Array] = {}
        anchors = np.array(self._anchors)
        for anchor in np.unique(anchors).tolist():
            of_anchor = np.flatnonzero(anchors == anchor).tolist()
            for k in of_anchor:
                self._trajectory[self._indices[k]] = self._at(self._times_s[k] - self.added_s)
            middle = of_anchor[len(of_anchor) // 2]
            moved[anchor] = tidied(self._trajectory[self._indices[middle]] @ inverse(self._poses[middle]))
        self._anchor += 1  # points from now on are right
        return moved

    def _at(self, time_s: float) -> Float64Array:
        """Return the pose at a time, interpolated, or extrapolated by less than the largest offset."""
        last = len(self._times_s) - 1
        if self._times_s[0] <= time_s <= self._times_s[last]:
            near = slice(max(0, int(np.searchsorted(self._times_s, time_s)) - 2), None)
            stream = PoseStream("the frames", np.array(self._times_s[near]), self._poses[near])
            return stream.at(time_s)
        end, step = (last, -1) if time_s > self._times_s[last] else (0, 1)
        other = end
        while 0 <= other + step <= last and abs(self._times_s[other] - self._times_s[end]) < VELOCITY_S:
            other += step
        elapsed_s = self._times_s[end] - self._times_s[other]
        if not elapsed_s:
            raise FrameError("no camera pose: the poses of other frames are too far away in time")
        motion = log(inverse(self._poses[other]) @ self._poses[end]) / elapsed_s
        return tidied(self._poses[end] @ exp(motion * (time_s - self._times_s[end])))
