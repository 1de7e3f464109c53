from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import cuboid
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import SkippedFrame
from cuboid.lab.synthetic.faults import FRAME_FAULTS, spoil

REASONS = {
    "truncated-color": "color image .* truncated",
    "truncated-depth": "depth image .* truncated",
    "empty-color": "color image .* empty",
    "empty-depth": "depth image .* empty",
    "damaged-depth": "depth image .* damaged",
    "no-image": "neither a PNG nor a JPEG",
    "color-only": "color without depth",
    "depth-only": "depth without color",
    "other-size": "48x36",
    "zero-depth": "no reading",
    "nan-pose": "NaN or infinite",
    "inf-pose": "NaN or infinite",
    "non-rigid-pose": "quaternion",
    "no-pose": "no line for frame",
}


@pytest.fixture
def whole(small, tmp_path):
    return shutil.copytree(small, tmp_path / "copy")


def noted(path):
    notes = json.loads((path / "faults.json").read_text(encoding="utf-8"))["faults"]
    return {note["fault"]: note["frame"] for note in notes}


@pytest.mark.parametrize("fault", FRAME_FAULTS)
def test_a_fault_spoils_its_frame_and_no_other(fault, whole):
    spoil(whole, [fault], 12, np.random.default_rng(0))
    skipped = [item for item in cuboid.open_recording(whole).iterate() if isinstance(item, SkippedFrame)]
    assert [item.index for item in skipped] == [noted(whole)[fault]]
    with pytest.raises(cuboid.CuboidError, match=REASONS[fault]):
        cuboid.open_recording(whole).read(noted(whole)[fault])


def test_few_poses_leave_the_end_without(whole):
    spoil(whole, ["few-poses", "empty-depth"], 12, np.random.default_rng(0))
    skipped = {item.index for item in cuboid.open_recording(whole).iterate() if isinstance(item, SkippedFrame)}
    assert skipped == {11, noted(whole)["empty-depth"]}


@pytest.mark.parametrize(
    ("fault", "said"), [("no-intrinsics", "intrinsics"), ("wrong-depth-scale", r"nothing between 0\.1 and 20 m")]
)
def test_a_fault_of_the_whole_recording_is_told(fault, said, whole):
    spoil(whole, [fault], 12, np.random.default_rng(0))
    with pytest.raises(cuboid.CuboidError, match=said):
        cuboid.open_recording(whole).read(0)


def test_all_needs_a_frame_for_each(whole):
    with pytest.raises(InputError, match="14 faults need as many frames, the recording has 12"):
        spoil(whole, ["all"], 12, np.random.default_rng(0))
