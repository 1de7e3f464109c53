from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_truth import cube, write_csv

from cuboid.ground.core.errors import InputError
from cuboid.lab.evaluation.result import read_result

HEADER = "frame,label,cx,cy,cz,length,width,height,qw,qx,qy,qz"


def test_columns_of_a_csv_may_stand_in_any_order_with_others_between(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(
        "label,name,qz,qy,qx,qw,height,width,length,cz,cy,cx,frame\n"
        "7,mug,0.7071068,0,0,0.7071068,0.3,0.2,0.1,3,2,1,5\n"
        "2,cap,0,0,0,1,0.3,0.2,0.1,6,5,4,4\n",
        encoding="utf-8",
    )
    tracks = read_result(path).tracks
    assert tracks.frame.tolist() == [4, 5]
    assert tracks.label.tolist() == [2, 7]
    np.testing.assert_allclose(tracks.boxes[0], [4, 5, 6, 0.1, 0.2, 0.3, 1, 0, 0, 0, 1, 0, 0, 0, 1])
    np.testing.assert_allclose(tracks.boxes[1, 6:], [0, -1, 0, 1, 0, 0, 0, 0, 1], atol=1e-6)


def test_the_map_of_a_csv_is_the_last_box_of_each_label_ranked_by_frames(tmp_path: Path) -> None:
    sightings = [(0, 3, cube(0)), (1, 3, cube(1)), (2, 3, cube(2)), (2, 1, cube(9))]
    result = read_result(write_csv(tmp_path, sightings))
    assert result.objects.label.tolist() == [1, 3]
    assert result.objects.boxes[:, 0].tolist() == [9, 2]
    assert result.objects.score.tolist() == [1, 3]
    assert result.frames is None


def test_a_csv_without_rows_is_a_tracker_that_found_nothing(tmp_path: Path) -> None:
    result = read_result(write_csv(tmp_path, []))
    assert result.tracks.boxes.shape == result.objects.boxes.shape == (0, 15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", ":1: expected a header"),
        ("frame,label,cx\n", "missing: cy, cz, length"),
        (f"{HEADER}\n0,1,0,0,0,1,1,1,1,0,0\n", ":2: expected 12 values, got 11"),
        (
            f"{HEADER}\n0,1,0,0,0,1,1,1,1,0,0,0\n0,x,0,0,0,1,1,1,1,0,0,0\n",
            ":3: label: expected a whole number",
        ),
        (f"{HEADER}\n0,1,0,0,nan,1,1,1,1,0,0,0\n", ":2: cz: expected a finite number, got 'nan'"),
        (f"{HEADER}\n0,1,0,0,0,1,-1,1,1,0,0,0\n", ":2: width: expected a number of at least 0, got '-1'"),
        (f"{HEADER}\n0,1,0,0,0,1,1,1,0,0,0,0\n", ":2: the quaternion has length 0"),
        (f"{HEADER}\n0.5,1,0,0,0,1,1,1,1,0,0,0\n", ":2: frame: expected a whole number, got '0.5'"),
        (f"{HEADER}\n0,inf,0,0,0,1,1,1,1,0,0,0\n", ":2: "),
        (f"{HEADER}\n4,0,0,0,0,1,1,1,1,0,0,0\n", ":2: label: expected a whole number of at least 1, got '0'"),
        (f"{HEADER}\n" + "4,2,0,0,0,1,1,1,1,0,0,0\n" * 2, "label 2 stands more than once in frame 4"),
    ],
)
def test_a_bad_csv_is_one_line_that_says_where(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said) as caught:
        read_result(path)
    assert str(path) in str(caught.value)


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        read_result(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"run\.json"):
        read_result(tmp_path)
