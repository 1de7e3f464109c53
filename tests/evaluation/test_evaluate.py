from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
from made_truth import as_json, cube, follow, truth_document, write_csv, write_folder, write_truth

from cuboid.cli import evaluate as command
from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry.box import Box
from cuboid.lab.evaluation import Evaluation, evaluate


def judge(folder: Path, sightings: list[tuple[int, int, Box]], document: dict[str, object]) -> Evaluation:
    return evaluate(write_csv(folder, sightings), write_truth(folder, document))


def test_a_tracker_without_fault_has_full_marks(tmp_path: Path) -> None:
    there = [cube(0.0), cube(1.0)]
    shown = {2: [[1.0, 10], [0.0, 12], [0.8, 8]]}
    sightings = follow(there[0], 4, range(30)) + [
        row for row in follow(there[1], 9, range(30)) if not 10 <= row[0] < 22
    ]
    found = judge(tmp_path, sightings, truth_document(there, frames=30, shown=shown))
    assert found.frames_judged == 30
    assert found.identity.hota.hota == pytest.approx(1.0)
    for at in found.identity.at:
        assert (at.mota, at.idf1, at.switches, at.fragmentations) == (1.0, 1.0, 0, 0)
    assert [at.rate for at in found.identity.reidentification] == [1.0, 1.0, 1.0, None, None, None]
    assert (found.identity.label_purity, found.identity.labels_per_object) == (1.0, 1.0)
    assert [(item.box and item.box.label, item.labels and item.labels.labels) for item in found.objects] == [
        (4, (4,)),
        (9, (9,)),
    ]
    assert found.map.at[1].f1 == 1.0


def test_a_hardly_visible_object_may_be_found_and_an_invisible_one_may_not(tmp_path: Path) -> None:
    shown = {1: [[1.0, 4], [0.1, 3], [0.0, 3]]}
    document = truth_document([cube(0.0)], shown=shown)

    def wrong(last: int) -> tuple[int, int]:
        identity = judge(tmp_path, follow(cube(0.0), 1, range(last)), document).identity
        return identity.at[1].misses, identity.at[1].false_positives

    assert wrong(4) == (0, 0)
    assert wrong(7) == (0, 0)
    assert wrong(10) == (0, 3)
    assert wrong(3) == (1, 0)


def test_boxes_elsewhere_are_no_false_positives(tmp_path: Path) -> None:
    square = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]
    region = {"normal": [0, 0, 1], "offset": 0, "polygon": square, "hmin": 0, "hmax": 0.4}
    document = truth_document([cube(0.0), cube(0.3)], judged_region=region, ignore=[as_json(cube(-0.3))])
    document["objects"][1]["judged"] = False
    elsewhere = [(2.0, 5), (0.3, 6), (-0.3, 7), (0.0, 8)]
    sightings = [row for x, label in elsewhere for row in follow(cube(x), label, range(10))]
    for stray, false in (([], 0), (follow(cube(0.0, 0.3), 9, range(10)), 10)):
        identity = judge(tmp_path, sightings + stray, document).identity
        assert (identity.at[1].false_positives, identity.at[1].mota) == (false, 1.0 - false / 10)


def test_a_truth_without_visibility_judges_the_map_alone(tmp_path: Path) -> None:
    document = truth_document([cube(0.0)])
    del document["visibility"]
    found = judge(tmp_path, follow(cube(0.0), 1, range(3)), document)
    assert found.identity is None
    assert found.map.at[1].f1 == 1.0


def test_a_result_of_another_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has frame 12, but .*truth\.json is of a recording of 10 frames"):
        judge(tmp_path, [(12, 1, cube(0.0))], truth_document([cube(0.0)]))


def test_only_frames_that_the_tracker_used_are_judged(tmp_path: Path) -> None:
    write_folder(tmp_path, cube(0.0), range(0, 8, 4), every=2, read=4, skipped=(2, 6))
    found = evaluate(tmp_path, write_truth(tmp_path, truth_document([cube(0.0)])))
    assert (found.frames_judged, found.frames_skipped) == (2, 2)  # 0 and 4
    assert found.identity.at[1].misses == 0


def call(*words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return command.run(parser.parse_args(words))


def test_the_command_prints_tables_and_writes_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = [cube(0.0), cube(1.0)]
    path = write_csv(tmp_path, follow(there[0], 7, range(10)))
    write_truth(tmp_path, truth_document(there))
    target = tmp_path / "figures.json"
    assert call(str(path), str(tmp_path), "--json", str(target)) == 0
    shown = capsys.readouterr().out
    assert "10 frames judged" in shown
    assert "1 of 2" in shown
    assert "HOTA" in shown
    assert "re-identification rate" in shown
    figures = json.loads(target.read_text())
    assert (figures["format"], figures["version"]) == ("cuboid-evaluation", 1)
    assert figures["map"]["at"][1]["recall"] == 0.5
    assert figures["objects"][1]["labels"]["labels"] == []
    assert call(str(write_csv(tmp_path, [])), str(tmp_path), "--json", "-") == 0
    at = json.loads(capsys.readouterr().out)["identity"]["at"][0]
    assert (at["misses"], at["id_precision"]) == (20, None)


def test_the_comparison_of_the_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = [cube(0.0), cube(1.0)]
    found = judge(tmp_path, follow(there[0], 7, range(10)), truth_document(there))
    command.print_comparison(found)
    shown = capsys.readouterr().out
    assert "1 of 2 objects found at IoU 0.5, 0 boxes of no object" in shown
    assert "cube 2" in shown


@pytest.mark.parametrize("is_round", [True, False])
def test_a_round_object_may_be_turned_about_its_axis(tmp_path: Path, is_round: bool) -> None:
    c = np.sqrt(0.5)
    there = cube(0.0)
    turned = Box(there.center, there.size, np.array([[c, -c, 0], [c, c, 0], [0, 0, 1.0]]))
    document = truth_document([there])
    document["objects"][0]["round"] = is_round
    found = judge(tmp_path, follow(turned, 7, range(10)), document)
    # Two squares at 45 degrees share an octagon of 2 (sqrt 2 - 1) of either.
    octagon = 2 * (np.sqrt(2) - 1)
    assert found.map.at[0].mean_iou == pytest.approx(1.0 if is_round else octagon / (2 - octagon), abs=1e-6)
