"""Hostile sequences: no pose that is none gets into a frame; the tracker stands."""

from __future__ import annotations

from fire import Fired, fire, load_kernels
from hostile import KINDS, hostile

from cuboid.ground.geometry.se3 import is_rigid


def test_poses_that_are_none_stop_at_the_frame() -> None:
    seen: dict[str, set[bool]] = {}
    for seed in range(80):
        sequence = hostile(seed)
        if sequence.intrinsics.width > 64:
            continue
        for item in sequence.frames(60):
            seen.setdefault(item.kind, set()).add(item.frame is None)
            assert item.refused.isprintable()
            if item.frame is not None:
                assert item.frame.T_world_camera is not None
                assert is_rigid(item.frame.T_world_camera, 1e-9), item.kind
    assert set(seen) == set(KINDS)
    assert seen["mirrored pose"] == seen["pose of no numbers"] == {True}
    assert seen["scaled pose"] == {True, False}, "a thousandth off is rounding, a twentieth is not"
    assert seen["calm"] == seen["noise"] == {False}


def test_the_tracker_under_fire() -> None:
    """A short run of ``fire.py``: images of all sizes, few of the large ones."""
    load_kernels()
    fired = Fired()
    for seed in range(1000, 1020):
        large = hostile(seed).intrinsics.width > 320
        fire(seed, 20, fired, (160, 120) if large else None)
    fire(1008, 30, fired, (640, 480))
    assert not fired.faults, fired.first
    assert fired.frames > 350
    assert fired.labels > 10, "sequences without objects prove nothing"
