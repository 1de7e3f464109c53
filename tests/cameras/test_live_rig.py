"""Several live cameras as one source: frames in the order of their times, and a camera that is pulled out."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from played import CALIBRATION, PlayedDriver

import cuboid
from cuboid.cli import main
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.inputs.cameras import CAMERAS, LiveRig, Shot
from cuboid.inputs.cameras.live_rig import cameras_of, named_cameras
from cuboid.inputs.readers import Calibration
from cuboid.inputs.recordings.rig import RigRecording, read_rig
from cuboid.results.files import Results
from cuboid.runs.pipeline.options import RunHooks
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.pipeline.streaming import FrameSource
from cuboid.runs.tracking.types import Progress
from cuboid.services.ros2.node import RosNode
from fakes import FakeTracker

T_RIG_RIGHT = np.array([[0.0, 0.0, -1.0, 1.2], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.2], [0.0, 0.0, 0.0, 1.0]])
SMALL = Calibration(40.0, 40.0, 31.5, 23.5, (64, 48), "the fake")


def rig_file(folder: Path, serials: tuple[str, ...] = (), kind: str = "fixed") -> Path:
    poses = {"left": np.eye(4), "right": T_RIG_RIGHT}
    cameras = [{"name": name, "T_rig_camera": T.tolist()} for name, T in poses.items()]
    for camera, serial in zip(cameras, serials, strict=False):
        camera["serial"] = serial
    document = {"format": "cuboid-rig", "version": 1, "kind": kind, "cameras": cameras}
    (folder / "rig.json").write_text(json.dumps(document), encoding="utf-8")
    return folder / "rig.json"


Opened = Callable[..., LiveRig]


@pytest.fixture
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Opened:
    def open_drivers(*drivers: PlayedDriver, **options: object) -> LiveRig:
        left = iter(drivers)
        monkeypatch.setitem(CAMERAS._items, "toy", lambda options: next(left))
        return cuboid.open_cameras("toy:1,toy:2", rig_file(tmp_path), **options)

    return open_drivers


class Told(Progress):
    """Notes warnings, each with the number of frames so far."""

    def __init__(self) -> None:
        self.count, self.lines = 0, []

    def frame(self, result: cuboid.FrameResult) -> None:
        self.count += 1

    def warning(self, line: str) -> None:
        self.lines.append((self.count, line))


def fail() -> None:
    raise RuntimeError("xioctl(VIDIOC_DQBUF): No such device")


def test_frames_come_in_the_order_of_their_times_with_camera_and_pose(opened: Opened) -> None:
    with opened(PlayedDriver(6), PlayedDriver(4, calibration=SMALL, first_s=100.01, interval_s=0.05)) as rig:
        assert isinstance(rig, FrameSource)
        frames = list(rig)
    assert [frame.index for frame in frames] == list(range(10))
    times = [frame.timestamp_s for frame in frames]
    assert times == sorted(times)
    assert "".join(frame.camera_name[0] for frame in frames) == "lrlrllrlrl"
    right = next(frame for frame in frames if frame.camera_name == "right")
    assert right.camera.intrinsics.fx == SMALL.fx
    np.testing.assert_allclose(right.T_world_camera, T_RIG_RIGHT)
    assert rig.warnings == []


def test_close_ends_the_iteration_while_frames_wait(opened: Opened) -> None:
    with opened(PlayedDriver(100), PlayedDriver(100)) as rig:
        frames = iter(rig)
        next(frames)
        while any(camera.queue.head() is None for camera in rig._cameras):
            time.sleep(0.001)
        rig.close()
        ended = threading.Thread(target=lambda: list(frames), daemon=True)
        ended.start()
        ended.join(1.0)
        assert not ended.is_alive()


@pytest.mark.parametrize("ends", ["fails", "falls silent"])
def test_a_camera_that_is_pulled_out_loses_nothing_of_the_others(
    opened: Opened, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: str
) -> None:
    monkeypatch.setattr("cuboid.inputs.cameras.live_rig.CAMERA_SILENCE_S", 0.2)
    told = Told()
    # On a busy machine a live camera drops frames: the silent one has few frames, all of which may wait.
    then, count, paced = (fail, 40, True) if ends == "fails" else (lambda: time.sleep(0.01), 10, False)
    drivers = (
        PlayedDriver(count, paced=paced, every_s=0.02, interval_s=0.02),
        PlayedDriver(3, paced=paced, every_s=0.02, interval_s=0.02, then=then),
    )
    with opened(*drivers) as rig:
        hooks = RunHooks(make_tracker=FakeTracker, progress=told)
        outcome = track_recording(rig, tmp_path / "out", hooks=hooks)
    assert (outcome.report.frames_dropped, outcome.report.complete) == (0, True)
    found = outcome.report.config["rig"]
    assert found["cameras"] == ["left", "right"]
    assert found["frames"] == [count, 3]
    reason = "failed: RuntimeError: xioctl" if ends == "fails" else "gave no frame for 0.2 s"
    named = [line for line in outcome.report.warnings if line.startswith("camera right: ") and "depth" not in line]
    assert len(named) == 1
    assert reason in named[0]
    if paced:
        assert next(used for used, line in told.lines if line == named[0]) < 40  # while the run goes on
    text = (tmp_path / "out" / "tracks.csv").read_text(encoding="utf-8")
    assert text.partition("\n")[0].endswith(",camera")


def test_a_recorded_live_rig_tracked_again_gives_the_same(opened: Opened, tmp_path: Path) -> None:
    drivers = PlayedDriver(6, spoil=(2,)), PlayedDriver(5, calibration=SMALL, first_s=100.01)
    with opened(*drivers, record=tmp_path / "kept") as rig:
        track_recording(rig, tmp_path / "live", hooks=RunHooks(make_tracker=FakeTracker))
    kept = cuboid.open_recording(tmp_path / "kept")
    assert isinstance(kept, RigRecording)
    assert len(kept) == 10
    track_recording(kept, tmp_path / "again", hooks=RunHooks(make_tracker=FakeTracker))
    for name in ("tracks.csv", "objects.json", "trajectory.txt"):
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    assert Results(tmp_path / "live").recording.read(1).camera_name == "right"


def test_a_live_rig_can_be_added_to_a_scene(opened: Opened, tmp_path: Path) -> None:
    scene = tmp_path / "place.cuboid"
    with opened(PlayedDriver(4), PlayedDriver(3, calibration=SMALL, first_s=100.01)) as rig:
        track_recording(rig, tmp_path / "out", into=cuboid.IntoScene(scene))
    with cuboid.Scene.open(scene) as found:
        assert len(found.recordings) == 1
        found.write_results(tmp_path / "again")
    for name in ("out", "again"):  # the camera of each frame is known at the end of the run only
        assert Results(tmp_path / name).report.camera_of(1) == rig.rig.cameras[1]


def test_a_camera_with_its_own_clock_is_brought_to_that_of_the_first(opened: Opened) -> None:
    drivers = (
        PlayedDriver(30, paced=False, every_s=0.02, interval_s=0.02),
        PlayedDriver(30, paced=False, every_s=0.02, interval_s=0.02, first_s=7.0),
    )
    with opened(*drivers) as rig:
        frames = list(rig)
    times = {name: [one.timestamp_s for one in frames if one.camera_name == name] for name in ("left", "right")}
    apart = abs(times["left"][-1] - times["right"][-1])
    assert apart < 0.2
    assert any("has its own clock" in line for line in rig.warnings)


def test_results_of_a_camera_with_its_own_clock_have_the_stamps_of_its_images(
    opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cuboid.services.ros2.node.DIAGNOSE_EVERY_S", float("inf"))
    stamps: dict[str, list[float]] = {"left": [], "right": []}

    class Camera:
        frame_id = world = ""

        def __init__(self, name: str) -> None:
            self.name = name

        def stamp_ns(self, timestamp_s: float) -> int:
            stamps[self.name].append(timestamp_s)
            return 0

    drivers = (
        PlayedDriver(30, paced=False, every_s=0.02, interval_s=0.02),
        PlayedDriver(30, paced=False, every_s=0.02, interval_s=0.02, first_s=7.0),
    )
    with opened(*drivers) as rig:
        session = SimpleNamespace(names={}, take=lambda frame: None)
        RosNode({name: Camera(name) for name in stamps}, rig, session, SimpleNamespace(world=""), lambda: 0).run()
        assert any("has its own clock" in line for line in rig.warnings)
    for name, first_s in (("left", 100.0), ("right", 7.0)):
        assert stamps[name]
        assert set(stamps[name]) <= {first_s + 0.02 * k for k in range(30)}


def test_a_camera_whose_clock_steps_back_is_named_once(opened: Opened) -> None:
    stepping = PlayedDriver(8, interval_s=0.02)
    take = stepping.take

    def take_stepping(wait_s: float) -> Shot:
        shot = take(wait_s)
        return replace(shot, timestamp_s=shot.timestamp_s - (5.0 if stepping.taken > 4 else 0.0))

    stepping.take = take_stepping  # type: ignore[method-assign]
    with opened(PlayedDriver(8, interval_s=0.02), stepping) as rig:
        names = [frame.camera_name for frame in rig]
    assert (names.count("left"), names.count("right"), rig.dropped) == (8, 4, 4)
    named = [line for line in rig.warnings if "stepped back" in line]
    assert len(named) == 1
    assert named[0].startswith("camera right: its clock stepped back by 4.98 s")


def test_a_run_that_fails_leaves_no_thread_behind(opened: Opened, tmp_path: Path) -> None:
    class Failing(Progress):
        def frame(self, result: cuboid.FrameResult) -> None:
            if result.index == 15:
                names.extend(thread.name for thread in threading.enumerate())
                raise OSError("the disk is full")

    names: list[str] = []
    hooks = RunHooks(make_tracker=FakeTracker, progress=Failing())
    with opened(PlayedDriver(10), PlayedDriver(10)) as rig, pytest.raises(OSError, match="the disk is full"):
        track_recording(rig, tmp_path / "out", cuboid.TrackOptions(threads=2), hooks=hooks)
    assert any(name.startswith("cuboid-rig-watch") for name in names)
    assert not [one for one in threading.enumerate() if one.name.startswith("cuboid-rig-watch")]


def test_devices_are_named_on_the_command_line_or_in_the_file(tmp_path: Path) -> None:
    assert named_cameras("realsense:1,size=64x48,oak,ros2:/left/color,depth=/left/depth") == [
        "realsense:1,size=64x48",
        "oak",
        "ros2:/left/color,depth=/left/depth",
    ]
    file, rig = read_rig(rig_file(tmp_path, ("71", "72")))
    assert cameras_of("realsense", file, rig) == ["realsense:71", "realsense:72"]
    assert cameras_of("realsense:72,realsense:serial=71", file, rig) == ["realsense:serial=71", "realsense:72"]
    with pytest.raises(InputError, match=r"has 2 cameras \(left, right\), but 1 live camera was named"):
        cameras_of("realsense:71", file, rig)
    with pytest.raises(InputError, match="oak is named twice"):
        cameras_of("oak,oak", file, rig)


def test_wrong_calls_are_one_line(
    opened: Opened, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["track", "--camera", "oak:1,oak:2", "--output", str(tmp_path / "none")]) == 2
    assert "2 live cameras need --rig rig.json" in capsys.readouterr().err
    drivers = PlayedDriver(1), PlayedDriver(1)
    with pytest.raises(OutputError, match="frames are recorded into a new folder"):
        opened(*drivers, record=tmp_path)
    document = json.loads((tmp_path / "rig.json").read_text(encoding="utf-8"))
    document["cameras"][0]["name"], document["cameras"][1]["name"] = "c:1", "c/1"
    (tmp_path / "same.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(OutputError, match="'c:1' and 'c/1' would be written to one file"):
        cuboid.open_cameras("toy:1,toy:2", tmp_path / "same.json", record=tmp_path / "kept")
    monkeypatch.setitem(CAMERAS._items, "toy", lambda options: PlayedDriver(0, then=fail))
    with cuboid.open_cameras("toy:1,toy:2", tmp_path / "rig.json") as rig, pytest.raises(InputError, match="failed: "):
        list(rig)


def test_the_command_tracks_and_records_live_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drivers = iter((PlayedDriver(4), PlayedDriver(3, calibration=SMALL, first_s=100.01)))
    monkeypatch.setitem(CAMERAS._items, "toy", lambda options: next(drivers))
    monkeypatch.setattr("cuboid.runs.pipeline.ahead.compile_all", lambda progress: None)
    monkeypatch.setattr("cuboid.runs.pipeline.run._tracker", FakeTracker)
    rig, output, kept = rig_file(tmp_path), tmp_path / "out", tmp_path / "kept"
    call = ["track", "--camera", "toy:1,toy:2", "--rig", str(rig), "--output", str(output), "--record", str(kept)]
    assert main(call) == 0
    found = Results(output)
    assert (found.report.frames_used, found.report.rig_recordings) == (7, (str(kept / "left"), str(kept / "right")))
    assert found.recording.read(1).camera_name == "right"


def test_the_driver_of_each_camera_is_closed(opened: Opened) -> None:
    drivers = PlayedDriver(2), PlayedDriver(2)
    with opened(*drivers):
        pass
    assert [driver.closed for driver in drivers] == [1, 1]
    assert CALIBRATION.size == (64, 48)
