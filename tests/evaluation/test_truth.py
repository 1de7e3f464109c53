from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_truth import as_json, cube, truth_document, write_truth

from cuboid.ground.core.errors import InputError
from cuboid.lab.evaluation.truth import JudgedRegion, read_truth


def test_the_truth_of_a_real_scene_is_read(data_dir: Path) -> None:
    truth = read_truth(data_dir / "rgbd-scenes-v2" / "ground_truth" / "01.json")
    assert [item.name for item in truth.objects] == [
        "bowl, yellow",
        "soda can, green",
        "bowl, pale",
        "cap, white",
        "mug, yellow",
    ]
    assert truth.frames == 888
    assert truth.visibility.shape == (888, 5)
    assert truth.visibility[:4, 0].tolist() == [0.75, 0.75, 0.75, 0.8]
    centers = np.array([item.box.center for item in truth.objects])
    assert truth.region.contains(centers).all()
    assert not truth.region.contains(centers + 2.0 * truth.region.normal).any()
    assert not truth.region.contains(centers + np.array([3.0, 0.0, 0.0])).any()


def test_run_lengths_unroll_into_frames(tmp_path: Path) -> None:
    shown = {1: [[0.0, 2], [0.5, 3], [0.05, 5]]}
    truth = read_truth(write_truth(tmp_path, truth_document([cube(0), cube(1)], shown=shown)))
    assert truth.visibility[:, 0].tolist() == [0, 0, 0.5, 0.5, 0.5, 0.05, 0.05, 0.05, 0.05, 0.05]
    assert truth.visibility[:, 1].tolist() == [1.0] * 10


def test_a_folder_stands_for_the_truth_in_it(tmp_path: Path) -> None:
    write_truth(tmp_path, truth_document([cube(0)], ignore=[as_json(cube(4))]))
    truth = read_truth(tmp_path)
    assert len(truth.ignored) == 1
    assert truth.region is None


@pytest.mark.parametrize("tilt", [0.0, 0.4, np.pi / 2])
def test_a_region_need_be_neither_convex_nor_level(tilt: float) -> None:
    # An L on the floor; the square hollow at (1.5, 1.5) is outside.
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    polygon = np.column_stack([outline, np.full(6, 0.3)]) @ turn.T
    region = JudgedRegion(turn[:, 2], -0.3, polygon, (-0.05, 0.5))
    spots = [(0.5, 0.5), (1.5, 0.5), (0.5, 1.5), (1.5, 1.5), (-0.1, 0.5), (0.5, 2.1)]
    points = np.array([(x, y, 0.4) for x, y in spots]) @ turn.T
    assert region.contains(points).tolist() == [True, True, True, False, False, False]
    heights = np.array([(0.5, 0.5, z) for z in (0.2, 0.26, 0.3, 0.79, 0.81)]) @ turn.T
    assert region.contains(heights).tolist() == [False, True, True, True, False]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": "something"}, "expected format 'cuboid-truth' version 1"),
        ({"version": 2}, "expected format 'cuboid-truth' version 1"),
        ({"objects": [{"id": 1}]}, "field 'center' is missing"),
        (
            {"objects": [{"id": 1, **as_json(cube(0)), "size": [0.1, 0.0, 0.1]}]},
            r"size\[1\]: expected a number above 0",
        ),
        ({"objects": [{"id": 1, **as_json(cube(0)), "rotation": [[1, 0, 0]] * 3}]}, "expected a rotation"),
        ({"objects": [{"id": 1, **as_json(cube(0))}] * 2}, "object id 1 is there twice"),
        ({"visibility": {"frames": 10, "objects": {"1": [[1.0, 9]]}}}, "expected 10 frames, got 9"),
        ({"visibility": {"frames": 10, "objects": {}}}, "visibility of object 1 is missing"),
        ({"visibility": {"frames": 7, "objects": {"1": [[1.0, 7]]}}}, "7 frames, the file of 10"),
        ({"judged_region": {"normal": [0, 0, 1], "offset": 0, "hmin": 0, "hmax": 1, "polygon": []}}, "polygon"),
    ],
)
def test_a_bad_truth_is_one_line_with_its_file(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    path = write_truth(tmp_path, truth_document([cube(0)]) | change)
    with pytest.raises(InputError, match=said) as caught:
        read_truth(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
