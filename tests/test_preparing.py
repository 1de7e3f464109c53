"""Frames that are prepared ahead in a thread: the same results, few frames in memory, faults in their turn."""

from __future__ import annotations

import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.method.poses.sources import Posed
from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.measuring import FrameClock
from cuboid.runs.tracking.running import RunningTracker
from fakes import FakeRecording, FakeTracker

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
from warm_up import WarmUpRecording

FILES = "objects.json", "tracks.csv", "proposals.csv", "trajectory.txt", "map.ply"


class Rough(WarmUpRecording):
    """A camera on its side; one frame is broken, one shows nothing, one repeats the frame before, one has no pose."""

    intrinsics = Intrinsics(260.0, 260.0, 119.5, 159.5, 240, 320)

    def read(self, index: int) -> Frame:
        if index == 5:
            raise FrameError("the file is broken")
        frame = super().read(index - 1 if index == 11 else index)
        turned = [np.ascontiguousarray(np.rot90(image)) for image in (frame.color, frame.depth_m)]
        if index == 8:
            turned[1][:] = 0.0
        T = None if frame.T_world_camera is None or index == 14 else frame.T_world_camera.copy()
        if T is not None:  # x and y of the camera on its side
            T[:3, 0], T[:3, 1] = -T[:3, 1], T[:3, 0].copy()
        return Frame(index, index / 30.0, turned[0], turned[1], T)

    def without_poses(self) -> Rough:
        return Rough(poses=False, noise=self._noise)


@pytest.mark.parametrize("poses", ["given", "estimated"])
def test_results_do_not_depend_on_the_number_of_threads(tmp_path: Path, poses: str) -> None:
    found = {}
    for threads in (1, 2, 3):
        options = TrackOptions(threads=threads, poses=poses)
        outcome = track_recording(
            Rough(noise=0.003), tmp_path / str(threads), options, results=ResultOptions(page=False)
        )
        files = {name: (tmp_path / str(threads) / name).read_bytes() for name in FILES}
        found[threads] = outcome.report.skipped, outcome.report.frames_used, files
    skipped, used, files = found[1]
    reasons = dict(skipped)
    assert used > 10
    assert files["tracks.csv"].count(b"\n") > 5
    assert reasons[5] == "the file is broken"
    assert "no reading" in reasons[8]
    assert (14 in reasons) == (poses == "given")
    assert found[2] == found[1]
    assert found[3] == found[1]


class Ready(FakeTracker):
    """A tracker that prepares frames; the recording of its run is `recording`."""

    faulty = -1

    def prepare(self, frame: Frame) -> Any:
        if frame.index == self.faulty:
            raise ZeroDivisionError("a bug")
        return frame.index

    def update(self, frame: Frame, anchor: int = 0, prepared: Any = None) -> FrameResult:
        assert prepared == frame.index
        return super().update(frame, anchor)


def run(recording: Any, tracker: type[FakeTracker], **hooks: Any) -> FakeTracker:
    made: list[FakeTracker] = []

    def make(*arguments: Any) -> FakeTracker:
        made.append(tracker(*arguments))
        return made[0]

    try:
        track_recording(recording, None, TrackOptions(threads=2), hooks=RunHooks(make_tracker=make, **hooks))
    finally:
        assert "cuboid-decode" not in {thread.name for thread in threading.enumerate()}
    return made[0]


def test_two_frames_at_most_are_ahead() -> None:
    recording, ahead = FakeRecording(12), []
    run(recording, Ready, watch=lambda frame, *_: ahead.append(len(recording.reads) - 1 - frame.index))
    assert len(ahead) == 12
    assert max(ahead) <= 2


class Live:
    """A camera whose frames are ready at once."""

    name, depth_units_per_metre, has_poses, record, dropped = "live", 1000.0, True, None, 0

    def __init__(self) -> None:
        self.recording, self.warnings = FakeRecording(12), []
        self.intrinsics = self.recording.intrinsics

    def __iter__(self) -> Any:
        return (self.recording.read(k) for k in range(12))


def test_of_a_live_camera_one_frame_at_most_is_ahead() -> None:
    camera, ahead = Live(), []
    reads = camera.recording.reads
    run(camera, Ready, watch=lambda frame, *_: ahead.append(len(reads) - 1 - frame.index))
    assert len(ahead) == 12
    assert max(ahead) <= 1


def test_a_fault_of_the_program_comes_with_its_frame() -> None:
    class Faulty(Ready):
        faulty = 6

    shown: list[int] = []
    with pytest.raises(ZeroDivisionError, match="a bug"):
        run(FakeRecording(12), Faulty, watch=lambda frame, *_: shown.append(frame.index))
    assert shown == list(range(6))


def test_a_stopped_run_ends_the_thread() -> None:
    shown: list[int] = []
    run(FakeRecording(12), Ready, watch=lambda frame, *_: shown.append(frame.index), stop=lambda: len(shown) == 3)
    assert shown == [0, 1, 2]


def test_the_map_of_a_stopped_run_follows_the_poses_that_frames_ahead_corrected() -> None:
    class Correcting:
        """Each frame moves the keyframe with its number."""

        def locate(self, frame: Frame) -> Posed:
            return Posed(np.eye(4), frame.index, {frame.index: np.eye(4)})

    recording = FakeRecording(4)
    mapper = FakeTracker(recording.intrinsics)
    tracker = RunningTracker(recording.intrinsics, TrackerConfig(), mapper, Correcting(), None)
    prepared = [tracker.prepare(recording.read(k)) for k in range(3)]
    tracker.step(prepared[0], FrameClock())
    assert [list(moved) for moved in mapper.carried] == [[0]]
    tracker.leave_out_prepared()
    assert [list(moved) for moved in mapper.carried] == [[0], [1], [2]]
    assert mapper.frames == [0]
    tracker.leave_out_prepared()
    assert len(mapper.carried) == 3


def test_frames_of_a_wrong_size_and_unit_are_skipped_in_their_turn() -> None:
    class Mixed(FakeRecording):
        def read(self, index: int) -> Frame:
            frame = super().read(index)
            if index == 3:
                return replace(frame, color=frame.color[1:], depth_m=frame.depth_m[1:])
            return replace(frame, depth_m=frame.depth_m * 1000) if index == 4 else frame

    reports = []
    for threads in (1, 2):
        options, hooks = TrackOptions(threads=threads), RunHooks(make_tracker=FakeTracker)
        reports.append(track_recording(Mixed(8), None, options, hooks=hooks).report.skipped)
    assert [frame for frame, _ in reports[0]] == [3, 4]
    assert reports[1] == reports[0]
