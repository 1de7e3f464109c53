"""Heat against labelled points, by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_truth import as_json, cube, truth_document, write_truth

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import MapPoints
from cuboid.lab.evaluation.points import (
    HEAT_REACH_M,
    HeatAt,
    LabelledCloud,
    heat_quality,
    read_labelled_cloud,
)
from cuboid.lab.evaluation.truth import Truth, read_truth
from cuboid.results.files import write_map


def line(count: int) -> np.ndarray:
    """Return points a metre apart along x, on the floor."""
    return np.column_stack([np.arange(count), np.zeros(count), np.full(count, 0.05)])


@pytest.fixture
def truth(tmp_path: Path) -> Truth:
    return read_truth(write_truth(tmp_path, truth_document([cube(50.0)])))


def test_precision_and_recall_over_heat(truth: Truth) -> None:
    cloud = LabelledCloud(line(5), np.array([True, True, False, False, True]))
    heat = np.array([0.9, 0.5, 0.7, 0.1])  # the fifth point is near no point of the map
    found = heat_quality(line(4), heat, cloud, truth)
    assert (found.points, found.object_points, found.mapped) == (5, 3, 0.8)
    at = {round(row.heat, 2): row for row in found.curve}
    assert at[0.85] == HeatAt(pytest.approx(0.85), 1.0, 1 / 3, 2 / 4)
    assert at[0.6] == HeatAt(pytest.approx(0.6), 1 / 2, 1 / 3, 2 / 5)
    assert at[0.4] == HeatAt(pytest.approx(0.4), 2 / 3, 2 / 3, 4 / 6)
    assert at[1.0].precision is None
    # The envelope is 1 up to recall 1/3 and 2/3 up to 2/3; the last third is never reached.
    assert found.ap == pytest.approx((1 + 2 / 3) / 3)
    assert found.best.f == pytest.approx(2 / 3)


def test_equally_hot_points_are_taken_together(truth: Truth) -> None:
    cloud = LabelledCloud(line(4), np.array([True, False, False, True]))
    assert heat_quality(line(4), np.full(4, 0.5), cloud, truth).ap == pytest.approx(0.5)


def test_a_point_reaches_only_the_map_near_it(truth: Truth) -> None:
    cloud = LabelledCloud(
        line(2) + np.array([[0.99 * HEAT_REACH_M, 0, 0], [1.01 * HEAT_REACH_M, 0, 0]]), np.ones(2, bool)
    )
    assert heat_quality(line(2), np.ones(2), cloud, truth).mapped == 0.5


def test_points_that_are_not_judged_are_left_out(tmp_path: Path) -> None:
    square = [[-0.5, -1, 0], [2.5, -1, 0], [2.5, 1, 0], [-0.5, 1, 0]]
    region = {"normal": [0, 0, 1], "offset": 0, "polygon": square, "hmin": 0, "hmax": 1}
    document = truth_document([cube(1.0)], judged_region=region, ignore=[as_json(cube(2.0))])
    document["objects"][0]["judged"] = False
    cloud = LabelledCloud(line(4), np.array([True, False, True, True]))
    found = heat_quality(line(4), np.ones(4), cloud, read_truth(write_truth(tmp_path, document)))
    assert (found.points, found.object_points) == (1, 1)


def test_a_map_without_points_is_cold_everywhere(truth: Truth) -> None:
    found = heat_quality(np.zeros((0, 3)), np.zeros(0), LabelledCloud(line(2), np.ones(2, bool)), truth)
    assert (found.mapped, found.ap) == (0.0, 0.0)


def test_a_made_cloud_is_read(tmp_path: Path) -> None:
    points = MapPoints(
        line(3).astype(np.float32), np.zeros((3, 3), np.uint8), np.zeros(3, np.float32), np.array([0, 7, 2], np.int32)
    )
    write_map(tmp_path / "true_cloud.ply", points)
    cloud = read_labelled_cloud(tmp_path / "true_cloud.ply")
    np.testing.assert_allclose(cloud.xyz, line(3), atol=1e-6)
    assert cloud.on_object.tolist() == [False, True, True]


def test_a_cloud_with_classes_in_a_file_beside_it_is_read(tmp_path: Path) -> None:
    rows = "".join(f"{x} 0 0.05 9 9 9\n" for x in range(10))
    head = "ply\nformat ascii 1.0\nelement vertex 10\n"
    head += "".join(f"property float {name}\n" for name in "xyz")
    head += "".join(f"property uchar diffuse_{name}\n" for name in ("red", "green", "blue"))
    (tmp_path / "01.ply").write_text(f"{head}end_header\n{rows}")
    (tmp_path / "01.label").write_text("10\n" + "".join(f"{k}\n" for k in range(1, 11)))
    cloud = read_labelled_cloud(tmp_path / "01.ply")
    assert np.flatnonzero(cloud.on_object).tolist() == [0, 1, 2, 3, 6]
    (tmp_path / "01.label").write_text("10\n1\n2\n")
    with pytest.raises(InputError, match=r"01\.label: expected 10 and as many classes, got 3"):
        read_labelled_cloud(tmp_path / "01.ply")
    (tmp_path / "01.label").unlink()
    with pytest.raises(InputError, match="expected points with a label"):
        read_labelled_cloud(tmp_path / "01.ply")


def test_what_is_no_cloud_is_said_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    with pytest.raises(InputError, match="cannot be read"):
        read_labelled_cloud(path)
    path.write_text("no cloud")
    with pytest.raises(InputError, match="is no PLY of points"):
        read_labelled_cloud(path)
