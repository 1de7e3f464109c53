from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from cuboid.inputs.calibration.pose_fit import Jump, PoseFit
from cuboid.runs.tracking.diagnosis import RunFacts, diagnose, explains

GOOD = RunFacts(
    frames_read=100,
    frames_used=98,
    frames_lost=0,
    frames_without_pose=2,
    every=1,
    depth_fraction=0.75,
    depth_median_m=1.1,
    depth_units_per_metre=1000.0,
    pose_fit=PoseFit(
        given=0.85,
        still=0.2,
        moves=True,
        convention=("inverse",),
        converted=0.3,
        shift=1,
        shifted=0.5,
        depth_factor=2.0,
        scaled=0.4,
        jump=None,
    ),
    up_known=True,
    planes=2,
    proposals=400,
    objects=8,
)


def _fit(**changes: Any) -> PoseFit:
    assert GOOD.pose_fit is not None
    return dataclasses.replace(GOOD.pose_fit, **changes)


def test_a_good_run_has_no_warnings() -> None:
    assert diagnose(GOOD) == ()
    assert diagnose(dataclasses.replace(GOOD, pose_fit=None)) == ()  # poses estimated
    # a camera that hardly moves: every hypothesis fits
    hardly = _fit(given=0.89, still=0.89, converted=0.89, shifted=0.89, scaled=0.89)
    assert diagnose(dataclasses.replace(GOOD, pose_fit=hardly)) == ()
    assert diagnose(dataclasses.replace(GOOD, pose_fit=dataclasses.replace(hardly, moves=False))) == ()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"frames_lost": 30}, "the camera was lost in 30 of 100 frames; move the camera more slowly"),
        ({"frames_lost": 30, "every": 3}, "the camera was lost in 30 of 100 frames; read all frames with --every 1"),
        ({"frames_without_pose": 40}, "40 of 100 frames have no camera pose and were not used; --bridge"),
        ({"depth_fraction": 0.06}, "depth has few readings: 6 % of the pixels (median)"),
        ({"pose_fit": _fit(given=0.1, scaled=0.9, depth_factor=0.1)}, "run again with --depth-scale 10000"),
        ({"pose_fit": _fit(given=0.1, scaled=0.9, depth_factor=10.0)}, "run again with --depth-scale 100"),
        (
            {"pose_fit": _fit(given=0.3, converted=0.9)},
            "the given poses are inverted (world to camera): with this convention, 90 % of the depth agrees with other "
            "frames, instead of 30 %; run again with --pose-convention inverse",
        ),
        (
            {"pose_fit": _fit(given=None, converted=0.9, convention=("wxyz", "mm"))},
            "quaternions with w first and in millimetres: with this convention, 90 % of the depth agrees with "
            "other frames, instead of 0 %; run again with --pose-convention wxyz,mm",
        ),
        (
            {"pose_fit": _fit(given=0.7, shifted=0.95, shift=3)},
            "the given poses are 3 frames too late: with corrected times",
        ),
        (
            {"pose_fit": _fit(given=0.7, shifted=0.95, shift=-2)},
            "the given poses are 2 frames too early",
        ),
        (
            {"pose_fit": _fit(given=0.5, moves=False)},
            "the given poses are all the same, but the picture changes",
        ),
        ({"pose_fit": _fit(jump=Jump(41, 10.0))}, "the given poses jump by 10.0 m at frame 41"),
        ({"pose_fit": _fit(given=0.2)}, "the given poses do not explain the frames: only 20 % of the depth"),
        (
            {"depth_median_m": 13.0, "pose_fit": None},
            "probably wrong: the median depth is 13 m; at --depth-scale 10000 it is 1.3 m",
        ),
        (
            {"depth_median_m": 0.11, "pose_fit": _fit(scaled=0.8)},
            "probably wrong: the median depth is 0.11 m; at --depth-scale 100 it is 1.1 m",
        ),
        ({"depth_median_m": 13.0, "pose_fit": _fit(moves=False)}, "probably wrong: the median depth is 13 m"),
        (
            {"depth_median_m": 13.0},
            "the median depth is 13 m, and depth and poses agree in scale: if the scene is not that far away, both",
        ),
        ({"depth_median_m": 0.11}, "if the scene is not that near, both are in another unit than metres"),
    ],
)
def test_each_fault_alone_gives_its_line_and_what_helps(change: dict, expected: str) -> None:
    (warning,) = diagnose(dataclasses.replace(GOOD, **change))
    assert expected in warning
    assert len(warning) < 300


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, "no object found: 400 3D proposals in 98 frames, none confirmed; check 'cuboid render DIR --show planes'"),
        ({"proposals": 0}, "no object found: no frame had a 3D proposal; check 'cuboid render DIR --show heat'"),
        (
            {"frames_used": 4},
            "no object found in 4 frames: none is probable enough; record more, or give a lower --min-probability",
        ),
        ({"frames_used": 4, "every": 9}, "--every 1 reads all"),
        ({"up_known": False}, "no object found, and up is not known: no floor or table was seen"),
        ({"depth_median_m": 5.2}, "no object found: the median depth is 5.2 m, objects are found up to 4 m"),
    ],
)
def test_an_empty_result_is_explained(change: dict, expected: str) -> None:
    (warning,) = diagnose(dataclasses.replace(GOOD, objects=0, **change))
    assert expected in warning


def test_an_empty_result_with_a_cause_is_not_explained_twice() -> None:
    (warning,) = diagnose(dataclasses.replace(GOOD, objects=0, up_known=False, depth_fraction=0.02))
    assert warning.startswith("depth has few readings")


def test_a_world_with_a_far_origin_is_named_since_points_are_32_bit_numbers() -> None:
    assert diagnose(dataclasses.replace(GOOD, farthest_m=1000.0)) == ()
    (warning,) = diagnose(dataclasses.replace(GOOD, farthest_m=583e3))
    assert "583 km from the origin of its world: points of the map are stored in steps of 6.2 cm" in warning
    # it explains no empty result
    assert len(diagnose(dataclasses.replace(GOOD, farthest_m=583e3, objects=0))) == 2


def test_causes_come_first() -> None:
    facts = dataclasses.replace(GOOD, pose_fit=None, depth_median_m=13.0, frames_lost=60)
    assert [warning.partition(" ")[2].split()[0] for warning in diagnose(facts)] == ["depth", "camera"]


def test_objects_without_up_are_no_fault() -> None:
    """A desk that is seen in parts: its objects are found all the same."""
    assert diagnose(dataclasses.replace(GOOD, up_known=False, planes=0)) == ()


def test_a_scale_that_the_poses_prove_is_named_once() -> None:
    facts = dataclasses.replace(GOOD, depth_median_m=11.0, pose_fit=_fit(given=0.1, scaled=0.9, depth_factor=0.1))
    (warning,) = diagnose(facts)
    assert "--depth-scale 10000" in warning


def test_poses_explain_unless_another_hypothesis_is_clearly_better() -> None:
    assert explains(_fit())
    assert explains(_fit(converted=0.92, shifted=0.94))  # by a few percent: no proof
    assert not explains(_fit(given=0.3, converted=0.9))
    assert not explains(_fit(given=0.8, shifted=0.95))
    assert not explains(_fit(given=0.84, scaled=0.98))
    assert not explains(_fit(given=0.2))
