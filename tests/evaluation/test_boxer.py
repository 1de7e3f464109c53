"""The table of boxes of Boxer and WildDet3D, as their own reader takes it, as a result and as a truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.boxer import read_boxer
from made_place import OBJECTS, write_place

HEADER = (
    "time_ns,tx_world_object,ty_world_object,tz_world_object,qw_world_object,qx_world_object,qy_world_object,"
    "qz_world_object,scale_x,scale_y,scale_z,name,instance,sem_id,prob"
)


def test_a_map_is_the_same_when_it_is_written_and_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results, table = write_place(tmp_path), tmp_path / "boxes.csv"
    assert main(["export", str(results), "--to", "boxer", "--output", str(table)]) == 0
    header, *rows = table.read_text().splitlines()
    assert header == HEADER
    assert all(row.split(",")[0] == "0" and len(row.split(",")) == 15 for row in rows)
    for one, made in zip(read_boxer(table), OBJECTS, strict=True):
        assert (one.label, one.name) == (made.label, made.name or "")
        assert one.probability == pytest.approx(made.score, abs=1e-6)
        np.testing.assert_allclose(one.box.corners(), made.box.corners(), atol=1e-5)
    for result in (results, table):
        found = evaluate(result, table)
        assert found.map.at[1].f1 == 1.0
        assert main(["evaluate", str(result), str(table)]) == 0
        assert "labels over time: not judged" in capsys.readouterr().out


def test_the_last_box_of_an_instance_counts_and_instances_may_begin_at_0(tmp_path: Path) -> None:
    path = tmp_path / "fused.csv"
    rows = [
        "5,1,0,0,1,0,0,0,0.1,0.1,0.1,cup,0,3,0.9",
        "9,2,0,0,1,0,0,0,0.1,0.1,0.1,cup,0,3,0.8",
        "5,3,0,0,1,0,0,0,0.1,0.1,0.1,,4,3,0.7",
    ]
    path.write_text("\n".join((HEADER, *rows)) + "\n")
    found = [(one.label, float(one.box.center[0]), one.probability) for one in read_boxer(path)]
    assert found == [(1, 2.0, 0.8), (5, 3.0, 0.7)]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["5,1,0,0,1,0,0,0,0.1,0.1,0.1,cup,-1,3,0.9"] * 2, ":3: instance -1 stands twice at time 5"),
        ([f"{time},0,0,0,1,0,0,0,1,1,1,cup,3,5,0.9" for time in (5, 9, 5)], ":4: instance 3 stands twice at time 5"),
        (["5,1,0,0,1,0,0,0,0.1,0.1,0.1,cup,1,3,9"], ":2: prob: "),
        (["5,1,0,0,1,0,0,0,0.1,0.1,cup,1,3,0.9"], ":2: expected 15 values, got 14"),
    ],
)
def test_a_bad_table_is_one_line(tmp_path: Path, rows: list[str], said: str) -> None:
    path = tmp_path / "frames.csv"
    path.write_text("\n".join((HEADER, *rows)) + "\n")
    with pytest.raises(InputError, match="frames.csv" + said.replace(".", r"\.")):
        read_boxer(path)


@pytest.mark.parametrize("place", ["result", "truth"])
def test_a_table_of_2d_boxes_is_named(tmp_path: Path, place: str, capsys: pytest.CaptureFixture[str]) -> None:
    path, results = tmp_path / "owl_2dbbs.csv", write_place(tmp_path)
    header = "time_ns,frame_id,sensor,device,img_width,img_height,x1,y1,x2,y2,name,instance,sem_id,prob"
    path.write_text(f"{header}\n5,0,unknown,unknown,640,480,10,20,30,40,cup,-1,3,0.9\n")
    assert main(["evaluate", *map(str, (path, results) if place == "result" else (results, path))]) == 2
    assert f"{path}: is Boxer's table of 2D boxes in images; expected the table of its 3D" in capsys.readouterr().err
