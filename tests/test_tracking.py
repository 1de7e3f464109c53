"""The public tracker: frames with or without poses, the same results as the command, clear refusals."""

from __future__ import annotations

import dataclasses
import threading
from pathlib import Path

import numpy as np
import pytest

import cuboid
from cuboid.ground.core.errors import CuboidError, FrameError, OutputError
from cuboid.lab.evaluation import evaluate_keyframes
from cuboid.method.poses.sources import NO_POSE
from cuboid.results.files import Results
from cuboid.runs.pipeline.options import ResultOptions, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.running import NO_DEPTH
from fakes import INTRINSICS, FakeRecording
from made_scenes import CAMERA, frame_of, look_at, upright

# Poses given, estimated and corrected; none; a depth camera of its own; a measured up; one frame.
SAMPLES = {
    "scene_01": ("rgbd-scenes-v2/imgs/scene_01", {}),
    "desk": ("desk-realsense", {}),
    "dish": ("dish-from-above", {}),
    "overhead": ("overhead-hands", {}),
    "bin": ("bin-robot-hand", {}),
    "bag": ("containers/realsense/single_depth_color_640x480.bag", {}),
    "azure": ("containers/azure-kinect/recording.mkv", {}),
    "record3d": ("containers/record3d-exr", {}),
    "office, estimated": ("office-scan", {"poses": "estimated"}),
    "desk, corrected": ("desk-realsense", {"poses": "corrected"}),
    "desk, auto": ("desk-realsense", {"poses": "auto"}),
}
FILES = ("objects.json", "tracks.csv", "proposals.csv", "trajectory.txt", "map.ply")
LIMIT = 8
TRUTH = Path(__file__).resolve().parents[1] / "benchmarks" / "truth"
SCENE = [
    upright((0, 0), (1.4, 1.0, 0.05), z=-0.05),
    upright((-0.25, 0.1), (0.12, 0.08, 0.15), 0.4),
    upright((0.2, -0.1), (0.1, 0.1, 0.1), 0.2),
]


@pytest.mark.parametrize("name", SAMPLES)
def test_a_loop_in_python_gives_what_the_command_gives(data_dir: Path, tmp_path: Path, name: str) -> None:
    place, options = SAMPLES[name]
    recording = cuboid.open_recording(data_dir / place)
    command = TrackOptions(limit=LIMIT, **options)
    track_recording(recording, tmp_path / "command", command, results=ResultOptions(page=False))

    tracker = cuboid.Tracker(recording.intrinsics, **options)
    for frame in recording.iterate(limit=LIMIT):
        assert tracker.update(frame).index == frame.index
    tracker.save(tmp_path / "loop", recording=recording)

    for file in FILES:
        assert (tmp_path / "loop" / file).read_bytes() == (tmp_path / "command" / file).read_bytes(), file
    assert len(Results(tmp_path / "loop").objects) > 0, "also in a single frame"
    by_loop, by_command = (Results(tmp_path / way).report for way in ("loop", "command"))
    for field in ("recording", "format", "poses", "frames_read", "frames_used", "skipped", "warnings"):
        assert getattr(by_loop, field) == getattr(by_command, field), field
    assert (tmp_path / "loop" / "report.html").is_file()


def test_things_below_a_fixed_camera_are_found_where_color_shows_them(data_dir: Path, tmp_path: Path) -> None:
    """Upside down above a table; depth lies 20 pixels beside color; hands move."""
    recording = cuboid.open_recording(data_dir / "overhead-hands")
    track_recording(recording, tmp_path / "out", results=ResultOptions(page=False))
    judged = evaluate_keyframes(tmp_path / "out", TRUTH / "overhead-hands.json")
    at_half = next(at for at in judged.at if at.threshold == 0.5)
    assert at_half.one_label == 1.0
    assert at_half.precision is not None
    assert at_half.precision > 0.8
    found = {item.name: item.stages["labelled"] for item in judged.objects}
    assert found["ball, green and blue"] >= 5
    assert found["paper cup"] >= 8


def frames(count: int) -> list[cuboid.Frame]:
    poses = [look_at([0.9 * np.sin(a), -0.9 * np.cos(a), 0.7], [0, 0, 0.05]) for a in np.linspace(-0.4, 0.4, count)]
    return [frame_of(SCENE, T, k) for k, T in enumerate(poses)]


def test_a_frame_without_a_pose_among_posed_ones_is_skipped() -> None:
    tracker, shown = cuboid.Tracker(CAMERA), frames(3)
    tracker.update(shown[0])
    skipped = tracker.update(dataclasses.replace(shown[1], T_world_camera=None))
    assert skipped == cuboid.SkippedFrame(1, NO_POSE)
    assert tracker.poses == "given"
    assert isinstance(tracker.update(shown[2]), cuboid.FrameResult)


@pytest.mark.parametrize("none", [0.0, np.nan])
def test_frames_without_depth_are_skipped_with_their_reason(none: float) -> None:
    """The first of them would decide which way is up in the picture, later ones would see all objects."""
    blind, skipped, shown = cuboid.Tracker(CAMERA), cuboid.Tracker(CAMERA), frames(12)
    for frame in shown:
        if frame.index in (0, 7):
            found = blind.update(dataclasses.replace(frame, depth_m=np.full_like(frame.depth_m, none)))
            assert found == cuboid.SkippedFrame(frame.index, NO_DEPTH)
            assert found.sightings == ()
            skipped.update(cuboid.SkippedFrame(frame.index, NO_DEPTH))
        else:
            assert str(blind.update(frame).sightings) == str(skipped.update(frame).sightings)
    assert len(blind.objects) == 2
    assert str(blind.objects) == str(skipped.objects)
    assert blind.log.skipped == skipped.log.skipped == [(0, NO_DEPTH), (7, NO_DEPTH)]


def test_times_that_repeat_or_go_back_are_said_once() -> None:
    tracker, moved = cuboid.Tracker(CAMERA), {4: 3, 6: -3000, 7: -2999}
    for frame in frames(9):
        tracker.update(dataclasses.replace(frame, timestamp_s=moved.get(frame.index, frame.index) / 30))
    (said,) = tracker.warnings
    assert said.startswith("times repeat or go back at 2 frames, first at frame 4; motion of objects")


def test_frames_that_a_caller_got_wrong_are_refused_in_one_line() -> None:
    tracker, (first, second, third) = cuboid.Tracker(CAMERA), frames(3)
    with pytest.raises(FrameError, match=r"expected a cuboid\.Frame, got NoneType"):
        tracker.update(None)  # type: ignore[arg-type]
    tracker.update(second)
    for earlier in (second, first):
        with pytest.raises(FrameError, match=f"frame {earlier.index} comes after frame 1; indices must increase"):
            tracker.update(earlier)
    with pytest.raises(FrameError, match=r"median depth is .* must be in metres, not in millimetres"):
        tracker.update(dataclasses.replace(third, depth_m=third.depth_m * np.float32(1000)))
    small = cuboid.Frame(2, 0.1, third.color[:100], third.depth_m[:100], third.T_world_camera)
    with pytest.raises(FrameError, match=f"frame 2 is {CAMERA.width} x 100 pixels, expected {CAMERA.width} x"):
        tracker.update(small)
    assert isinstance(tracker.update(third), cuboid.FrameResult)  # nothing of all that has harmed it


def test_poses_have_known_words() -> None:
    with pytest.raises(ValueError, match="given, auto, corrected, estimated, synchronised, got 'imu'"):
        cuboid.Tracker(CAMERA, poses="imu")


def test_two_threads_cannot_take_in_frames_at_once() -> None:
    asked, answer = threading.Event(), threading.Event()

    def slow(frame: cuboid.Frame, intrinsics: cuboid.Intrinsics) -> cuboid.Proposals:
        asked.set()
        answer.wait(60)
        return cuboid.Proposals(np.zeros((0, 4)), np.zeros(0))

    tracker, (first, second) = cuboid.Tracker(CAMERA, proposals=slow), frames(2)
    thread = threading.Thread(target=tracker.update, args=(first,))
    thread.start()
    try:
        assert asked.wait(60)
        with pytest.raises(CuboidError, match="another thread is taking in a frame"):
            tracker.update(second)
    finally:
        answer.set()
        thread.join()
    assert isinstance(tracker.update(second), cuboid.FrameResult)


def test_saving_names_the_frames_that_were_left_out(tmp_path: Path) -> None:
    tracker, shown = cuboid.Tracker(CAMERA), frames(9)
    for index in (0, 2, 8):
        tracker.update(shown[index])
    tracker.update(cuboid.SkippedFrame(10, "torn"))
    tracker.save(str(tmp_path / "out"))
    report = Results(tmp_path / "out").report
    assert report.every == 2
    assert report.used().tolist() == [0, 2, 8]
    assert [frame for frame, _ in report.skipped] == [4, 6, 10]
    assert report.skipped[-1] == (10, "torn")
    assert len(Results(tmp_path / "out").poses) == 3


def test_saving_twice_needs_force(tmp_path: Path) -> None:
    tracker = cuboid.Tracker(CAMERA)
    tracker.update(frames(1)[0])
    tracker.save(tmp_path / "out")
    with pytest.raises(OutputError, match="--force replaces the results"):
        tracker.save(tmp_path / "out")
    tracker.save(tmp_path / "out", force=True)


def test_a_tracker_without_frames_saves_an_empty_result(tmp_path: Path) -> None:
    cuboid.Tracker(INTRINSICS).save(tmp_path / "out", recording=FakeRecording(0))
    assert Results(tmp_path / "out").report.frames_read == 0


def test_results_name_the_configuration_in_use(tmp_path: Path) -> None:
    """A sensor that is noisier than was set: the noise that the first frame shows is used, and written."""
    rng, nominal = np.random.default_rng(2), cuboid.TrackerConfig().depth_noise_per_m
    tracker = cuboid.Tracker(CAMERA)
    for k, x in enumerate((0.0, 0.05)):
        frame = frame_of(SCENE, look_at((x, -1.0, 0.8), (0, 0, 0)), k)
        noisy = frame.depth_m + rng.normal(size=frame.depth_m.shape) * 1.3 * nominal * frame.depth_m**2
        tracker.update(dataclasses.replace(frame, depth_m=noisy.astype(np.float32)))
    assert tracker.config.depth_noise_per_m > 1.1 * nominal
    tracker.save(tmp_path / "out")
    written = Results(tmp_path / "out").report.config["tracker"]
    assert written == tracker.config.to_dict()
