"""A recording written as each container gives the objects that the plain folder gives."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1]))

from made_containers import LOSSLESS, LOSSY, Frames, plain

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.geometry.overlap import iou
from cuboid.inputs.readers import open_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import cast, look_at, upright

FLOOR = upright((0, 0), (8, 8, 0.1), z=-0.85)
TABLE = upright((0, 0), (1.4, 1.0, 0.05), z=-0.05)
THINGS = [
    upright((-0.25, 0.1), (0.12, 0.08, 0.15), 0.4),
    upright((0.2, -0.1), (0.1, 0.1, 0.1), 0.2),
    upright((0.05, 0.25), (0.16, 0.1, 0.07), 0.9),
]
COUNT = 16
SMALL = Intrinsics(270.0, 270.0, 159.5, 119.5, 320, 240)
# That of the only container whose camera is fixed.
ICL = Intrinsics(481.2, 480.0, 319.5, 239.5, 640, 480)


def made(camera: Intrinsics) -> Frames:
    """A table with three boxes, from an arc round it; depth in whole millimetres."""
    color, depth_mm, poses = [], [], []
    for k, angle in enumerate(np.linspace(-0.6, 0.6, COUNT) - np.pi / 2):
        T = look_at([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.8], [0, 0, 0.05])
        depth, hit = cast([FLOOR, TABLE, *THINGS], T, camera)
        noisy = depth + np.random.default_rng(k).normal(size=depth.shape) * 1e-3 * depth**2
        color.append(((hit[..., None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8))
        depth_mm.append(np.where(depth > 0, np.rint(1000 * noisy), 0).astype(np.uint16))
        poses.append(T)
    return Frames(camera, color, depth_mm, poses)


def tracked(path: Path, poses: list[np.ndarray]) -> list[TrackedObject]:
    """The objects of a recording; a container that keeps no poses gets them from beside."""
    recording = open_recording(path)
    assert len(recording) == COUNT
    tracker = PosedTracker(recording.intrinsics)
    for frame in recording.iterate(prefetch=False):
        assert isinstance(frame, Frame), frame
        # The world that was made has z up, whatever is usual in worlds of this container.
        pose = poses[frame.index] if frame.T_world_camera is None else frame.T_world_camera
        tracker.update(dataclasses.replace(frame, T_world_camera=pose, up_camera=None))
    return tracker.objects


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[Intrinsics, tuple[Frames, list[TrackedObject]]]:
    """By camera the frames, and the objects of their plain folder."""
    found = {}
    for camera in (SMALL, ICL):
        frames = made(camera)
        found[camera] = (frames, tracked(plain(frames, tmp_path_factory.mktemp("plain")), frames.poses))
        assert [one.label for one in found[camera][1]] == [1, 2, 3]
    return found


def write(name: str, frames: Frames, root: Path) -> Path:
    needs = {"record3d": "OpenEXR", "record3d-file": "liblzfse"}
    if name in needs:
        pytest.importorskip(needs[name], reason="pip install '.[phone]'")
    return (LOSSLESS | LOSSY)[name](frames, root)


@pytest.mark.parametrize("name", LOSSLESS)
def test_the_same_frames_give_the_same_objects(tmp_path, scenes, name):
    frames, want = scenes[ICL if name == "icl-nuim" else SMALL]
    path = write(name, frames, tmp_path / "recording")
    assert open_recording(path).format == name.partition(" ")[0]
    found = tracked(path, frames.poses)
    for one, other in zip(found, want, strict=True):
        assert (one.label, one.first_frame, one.frames_seen) == (other.label, other.first_frame, other.frames_seen)
        np.testing.assert_allclose(one.box.center, other.box.center, atol=1e-5)
        np.testing.assert_allclose(one.box.size, other.box.size, atol=1e-5)
        np.testing.assert_allclose(one.mean_color, other.mean_color, atol=0.5)


@pytest.mark.parametrize("name", LOSSY)
def test_frames_whose_color_was_compressed_give_the_same_labels(tmp_path, scenes, name):
    frames, want = scenes[SMALL]
    path = write(name, frames, tmp_path / "recording")
    assert open_recording(path).format == name
    found = tracked(path, frames.poses)
    assert [one.label for one in found] == [one.label for one in want]
    for one, other in zip(found, want, strict=True):
        assert iou(one.box, other.box) >= 0.95


def test_every_format_is_among_them():
    """All but those whose lens or depth is bent on the way in: Bonn's."""
    from cuboid.inputs.readers import READERS

    names = {name.partition(" ")[0] for name in LOSSLESS | LOSSY}
    assert set(READERS.names()) - names == {"bonn"}
