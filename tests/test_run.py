from __future__ import annotations

import dataclasses
import json
import threading
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.formats.folder import (
    AGENTS,
    EMBEDDINGS,
    EVENTS,
    OUTPUT_NAMES,
    PICTURE,
    REPORT,
    TRAJECTORY_ONLINE,
    VIDEO,
    VIEWS,
)
from cuboid.method.poses.sources import GivenPoses
from cuboid.results.files import read_objects, read_run, read_tracks, read_trajectory
from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.types import RunOutcome
from fakes import FakeRecording, FakeTracker

RESULTS = sorted(set(OUTPUT_NAMES) - {EVENTS, AGENTS, VIDEO, PICTURE, TRAJECTORY_ONLINE, VIEWS, EMBEDDINGS})


def track(
    recording: FakeRecording,
    output: Path | None,
    options: TrackOptions | None = None,
    results: ResultOptions | None = None,
    **hooks: Any,
) -> RunOutcome:
    given = RunHooks(**{"make_tracker": FakeTracker, **hooks})
    return track_recording(recording, output, options, results=results, hooks=given)


def test_all_files_of_the_contract_are_written_and_nothing_else(tmp_path: Path) -> None:
    track(FakeRecording(5), tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == RESULTS
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_frames_keep_their_numbers_with_every_limit_and_skipped_ones(tmp_path: Path) -> None:
    recording = FakeRecording(20, broken={6: "color/000006.png: truncated"}, lost=(9,))
    track(recording, tmp_path / "out", TrackOptions(every=3, limit=6))
    run = read_run(tmp_path / "out" / "run.json")
    assert recording.reads[:6] == [0, 3, 6, 9, 12, 15]
    assert set(recording.reads[6:]) <= {3, 12, 15}, "frames that show the object again, for the pictures of the page"
    assert (run.frames_read, run.frames_used) == (6, 4)
    assert run.skipped == ((6, "color/000006.png: truncated"), (9, "the frame has no camera pose"))
    assert [row.frame for row in read_tracks(tmp_path / "out" / "tracks.csv")] == [3, 12, 15]
    assert len(read_trajectory(tmp_path / "out" / "trajectory.txt")) == 4
    assert run.complete


def test_correcting_the_map_is_a_stage_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    locate = GivenPoses.locate
    moved = {0: np.eye(4)}
    monkeypatch.setattr(GivenPoses, "locate", lambda self, frame: dataclasses.replace(locate(self, frame), moved=moved))
    stages = track(FakeRecording(4), None).milliseconds
    assert "correction" in stages
    assert "carry" not in stages


def test_a_frame_that_the_tracker_refuses_is_skipped(tmp_path: Path) -> None:
    def make(*args: Any) -> FakeTracker:
        tracker = FakeTracker(*args)
        tracker.refuse = {1: "no depth in reach"}
        return tracker

    outcome = track(FakeRecording(4), None, make_tracker=make)
    assert outcome.report.skipped == ((1, "no depth in reach"),)
    assert outcome.report.frames_used == 3


def test_more_than_half_bad_frames_is_an_error_that_leaves_nothing(tmp_path: Path) -> None:
    broken = dict.fromkeys(range(1, 7), "depth image is truncated")
    with pytest.raises(InputError, match=r"more than half of the 10 frames.*frame 1: depth image is trunc"):
        track(FakeRecording(10, broken), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_exactly_half_bad_frames_is_a_result(tmp_path: Path) -> None:
    broken = {0: "no pose", **{i: f"depth/{i:03d}.png is empty ({i} bytes)" for i in range(1, 5)}}
    report = track(FakeRecording(10, broken), tmp_path / "out").report
    assert report.frames_used == 5
    assert [(kind.frame, kind.reason, kind.count) for kind in report.skipped_kinds()] == [
        (1, "depth/001.png is empty (1 bytes)", 4),
        (0, "no pose", 1),
    ]


def test_what_cannot_be_posed_is_one_line(tmp_path: Path) -> None:
    for options, recording, message in (
        ({"poses": "given"}, FakeRecording(3, poses=False), "has no camera poses; --poses estimated takes them"),
        ({"bridge": True}, FakeRecording(3, poses=False), "--bridge fills gaps between given poses"),
        ({"poses": "estimated", "bridge": True}, FakeRecording(3), "--bridge fills gaps between given poses"),
        ({}, FakeRecording(3, poses=False), "no frame has enough depth and texture"),
        ({"poses": "estimated"}, FakeRecording(3), "no frame has enough depth and texture"),
    ):
        with pytest.raises(InputError, match=message):
            track(recording, tmp_path / "out", TrackOptions(**options))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("scale", [1, 2, 4])
def test_results_stay_in_the_recordings_pixels(tmp_path: Path, scale: int) -> None:
    trackers: list[FakeTracker] = []

    def make(*args: Any) -> FakeTracker:
        trackers.append(FakeTracker(*args))
        return trackers[-1]

    recording = FakeRecording(3)
    track(recording, tmp_path / "out", TrackOptions(scale=scale), make_tracker=make)
    assert trackers[0].sizes == [(48 // scale, 64 // scale, 3)] * 3
    assert trackers[0].intrinsics == recording.intrinsics.downscaled(scale)
    rows = read_tracks(tmp_path / "out" / "tracks.csv")
    np.testing.assert_array_equal(rows[0].rect_xyxy, np.array([1.0, 2.0, 11.5, 12.25]) * scale)
    assert read_objects(tmp_path / "out" / "objects.json").intrinsics == recording.intrinsics
    assert read_run(tmp_path / "out" / "run.json").config["scale"] == scale


def test_same_input_twice_gives_the_same_bytes_with_one_thread_or_two(tmp_path: Path) -> None:
    for name, threads in (("a", 1), ("b", 1), ("c", 2)):
        track(FakeRecording(30, {4: "bad"}), tmp_path / name, TrackOptions(threads=threads))
    for name in set(RESULTS) - {"run.json", REPORT}:
        contents = {(tmp_path / run / name).read_bytes() for run in "abc"}
        assert len(contents) == 1, name


def test_the_whole_frame_counts_decoding_and_every_stage() -> None:
    timings = track(FakeRecording(30), None, TrackOptions(scale=2)).report.milliseconds
    assert list(timings) == ["frame", "decode", "scale", "poses", "proposals", "matching"]
    assert timings["matching"].median_ms == pytest.approx(2.0)
    assert timings["frame"].median_ms >= timings["decode"].median_ms + timings["scale"].median_ms


def test_with_one_thread_no_other_is_started() -> None:
    names: dict[int, set[str]] = {1: set(), 2: set()}

    class Watched(FakeRecording):
        def read(self, index: int) -> Any:
            names[threads].add(threading.current_thread().name)
            return super().read(index)

    for threads in names:
        track(Watched(5), None, TrackOptions(threads=threads))
    assert names[1] == {threading.main_thread().name}
    assert threading.main_thread().name not in names[2]


def test_stopping_writes_what_is_done_and_says_so(tmp_path: Path) -> None:
    asked = iter([False] * 4 + [True])
    recording = FakeRecording(1000)
    track(recording, tmp_path / "out", TrackOptions(threads=2), stop=lambda: next(asked))
    run = read_run(tmp_path / "out" / "run.json")
    assert not run.complete
    assert run.frames_used == 4
    assert max(recording.reads) < 10
    assert json.loads((tmp_path / "out" / "objects.json").read_text())["objects"][0]["frames_seen"] == 3


def test_a_fault_leaves_nothing(tmp_path: Path) -> None:
    class Broken(FakeTracker):
        def update(self, frame: Any, anchor: int = 0) -> Any:
            if frame.index == 3:
                raise ZeroDivisionError
            return super().update(frame)

    with pytest.raises(ZeroDivisionError):
        track(FakeRecording(5), tmp_path / "out", TrackOptions(threads=2), make_tracker=Broken)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("scale", [1, 2])
def test_the_video_has_every_used_frame_at_full_size(tmp_path: Path, scale: int) -> None:
    options = TrackOptions(scale=scale, every=2)
    track(FakeRecording(5, {2: "bad"}), tmp_path / "out", options, ResultOptions(video=True))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted([*RESULTS, VIDEO])
    with av.open(str(tmp_path / "out" / VIDEO)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert container.streams.video[0].average_rate == 15
    assert [frame.shape for frame in frames] == [(48, 64, 3)] * 2


def test_a_video_that_cannot_be_written_names_the_output_folder(tmp_path: Path) -> None:
    class Full:
        def __init__(self, path: Path, *_: object) -> None:
            self.path = path

        def show(self, *_: object) -> None:
            raise OutputError(f"{self.path}: cannot be written: the disk is full")

        def close(self, complete: bool) -> None:
            assert not complete

    with pytest.raises(OutputError, match=rf"{tmp_path}/out/labelled.mp4: cannot be written"):
        track(FakeRecording(3), tmp_path / "out", results=ResultOptions(video=True), make_view=Full)
    assert list(tmp_path.iterdir()) == []


def test_the_recording_itself_is_no_output(tmp_path: Path) -> None:
    recording = FakeRecording(2)
    recording.path = tmp_path
    with pytest.raises(OutputError, match="is the recording itself"):
        track(recording, tmp_path, results=ResultOptions(force=True))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"every": 0}, "every and limit >= 1"),
        ({"limit": 0}, "every and limit >= 1"),
        ({"scale": 3}, "scale must be one of"),
        ({"detector_every": 0}, "detector_every must be >= 1"),
        ({"poses": "gps"}, "poses must be one of given"),
    ],
)
def test_options_out_of_range_are_refused_when_they_are_made(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TrackOptions(**options)


def test_an_empty_recording_is_an_error() -> None:
    with pytest.raises(InputError, match="no frames"):
        track(FakeRecording(0), None)


def test_who_watches_sees_each_used_frame_with_the_tracker_as_it_is_then() -> None:
    seen: list[tuple[int, tuple[int, ...], int, int]] = []

    def watch(frame: Any, result: Any, tracker: Any) -> None:
        seen.append((frame.index, frame.color.shape, result.index, tracker.points_known))

    outcome = track(FakeRecording(4, {1: "bad"}), None, TrackOptions(scale=2), watch=watch)
    assert seen == [(0, (48, 64, 3), 0, 1), (2, (48, 64, 3), 2, 2), (3, (48, 64, 3), 3, 3)]
    assert "live" in outcome.milliseconds
