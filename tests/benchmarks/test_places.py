from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cuboid import open_recording
from cuboid.lab.evaluation import read_keyframes
from cuboid.lab.evaluation.reliability import reliability
from cuboid.lab.synthetic import KINDS
from place_figures import Judgement, pool
from place_list import DATA, FURTHER, Folders, Part, Place, drawn_truth, made_places, real_places
from place_tables import differences, means_table, places_table, verdict
from place_tracking import Checkout, track
from still_recordings import FRAMES, StillSet, still_parts

PLACES = Path(__file__).resolve().parents[2] / "benchmarks" / "places.py"
SOURCE = Path(__file__).resolve().parents[2] / "src"


def judgement(wanted: int, found: int, false: int, rows: list[tuple[float, bool]] | None = None) -> Judgement:
    ranking = None if rows is None else (np.array([p for p, _ in rows]), np.array([right for _, right in rows]))
    return Judgement(wanted, found, false, None, None, None, ranking, 0.5 if rows is None else None, None)


def test_truths_of_a_place_are_summed_not_averaged() -> None:
    rows = pool([judgement(1, 1, 0, [(0.4, True)]), judgement(3, 1, 2, [(0.9, False), (0.8, True), (0.1, False)])])
    assert (rows["recall"], rows["precision"], rows["f1"]) == (0.5, 0.5, 0.5)
    # Ranked together: false, right, right, false; two of four are never found.
    assert rows["ap"] == pytest.approx(0.5 * 2 / 3)
    # The AP of boxes is averaged with it by the number to be found.
    both = pool([judgement(4, 2, 0, [(0.9, True), (0.8, True)]), judgement(12, 1, 0)])
    assert both["ap"] == pytest.approx((4 * 0.5 + 12 * 0.5) / 16)


def test_nothing_found_is_the_worst_f1_and_no_gap_in_the_mean() -> None:
    nothing = pool([judgement(3, 0, 0, [])])
    assert (nothing["recall"], nothing["precision"], nothing["f1"], nothing["ap"]) == (0.0, None, 0.0, 0.0)


def row(name: str, kind: str, f1: float, made: bool = False, parts: tuple[str, ...] = ("a",)) -> dict[str, Any]:
    found = pool([Judgement(10, 5, 5, 1.0, f1, None, None, f1, reliability({1: True}, {1: 0.9}))])
    return {"name": name, "kind": kind, "iou": 0.5, "made": made, "parts": list(parts), **found, "f1": f1}


def test_the_table_names_each_place_and_why_one_failed() -> None:
    failed = {"name": "cellar", "kind": "room", "iou": 0.25, "made": False, "parts": [], "failed": "no light"}
    rows = [row("desk-1", "desk", 0.4), row("made desk", "desk", 0.6, made=True), failed]
    lines = places_table(rows).splitlines()
    assert lines[2].startswith("| desk-1 | desk | .5 | 10 | 5 | 5 | 0.500 | 0.500 | 0.400 |")
    assert "failed: no light" in lines[4]
    assert {line.count("|") for line in lines} == {lines[0].count("|")}
    means = means_table(rows)
    assert "| desk | 2 | 0.500 ± 0.000 | 0.500 ± 0.000 | 0.500 ± 0.100 |" in means
    assert "| real | 1 |" in means
    assert "0.400 (desk-1)" in means.splitlines()[-1]


def compared(*changes: tuple[str, float]) -> list[dict[str, Any]]:
    """Return the differences of places that rise by given values, each of a kind."""
    before = [row(f"{kind} {k}", kind, 0.5) for k, (kind, _) in enumerate(changes)]
    after = [row(f"{kind} {k}", kind, 0.5 + rise) for k, (kind, rise) in enumerate(changes)]
    return differences(after, before)


def test_a_rise_beyond_the_noise_is_taken() -> None:
    said = verdict(compared(("desk", 0.03), ("desk", 0.01), ("room", 0.02), ("bin", 0.02)), [])
    assert "mean F1 over 4 places rises by 0.0200, standard error 0.0041: taken, beyond the noise" in said
    assert said.endswith("kinds that fall: none")


def test_what_lifts_only_its_own_place_is_not_taken() -> None:
    changes = compared(("bin", 0.2), ("desk", 0.0), ("room", 0.001), ("shelf", -0.001))
    assert "not taken" in verdict(changes, ["bin"])
    assert "over 3 places, without bin" in verdict(changes, ["bin"])
    assert "not taken, not beyond the noise" in verdict(compared(("desk", 0.03), ("room", -0.02)), [])


def test_a_kind_that_falls_by_more_than_its_noise_refuses_the_change() -> None:
    said = verdict(compared(("desk", 0.1), ("desk", 0.1), ("desk", 0.1), ("desk", 0.1), ("bin", -0.1)), [])
    assert "rises by 0.0600" in said
    assert "not taken" in said
    assert said.endswith("kinds that fall: bin (-0.100)")


def test_only_places_with_the_same_recordings_are_compared() -> None:
    before = [row("made bin", "bin", 0.5, parts=("seed 1",)), row("desk", "desk", 0.5)]
    after = [row("made bin", "bin", 0.9, parts=("seed 2",)), row("desk", "desk", 0.6), row("new", "desk", 0.1)]
    assert [change["name"] for change in differences(after, before)] == ["desk"]
    assert verdict(differences(after, before), []).startswith("verdict: none")


def test_a_place_takes_every_truth_of_its_name_and_none_of_another_place() -> None:
    names = [path.name for path in drawn_truth("desk-realsense")]
    assert names == ["desk-realsense-second.json", "desk-realsense-third.json"]
    of = {place.name: drawn_truth(place.name) for place in (*DATA, *FURTHER)}
    files = [path for paths in of.values() for path in paths]
    assert len(files) == len(set(files)) == len(list((PLACES.parent / "truth").glob("*.json")))


def test_absent_places_are_named_and_the_others_taken(tmp_path: Path, data_dir: Path) -> None:
    found, absent = real_places(Folders(data_dir, None, None, tmp_path), every_still=20)
    assert {place.name for place in found} >= {"rgbd-scenes-v2", "desk-realsense", "bin-robot-hand", "hots"}
    assert {"cafe", "redkitchen", "osd_learn"} <= set(absent)
    assert all(truth.is_file() for place in found for part in place.parts for truth in part.truths)


def test_every_kind_of_made_scene_is_a_place(tmp_path: Path) -> None:
    places = made_places([1001, 1002], tmp_path)
    assert [place.name for place in places] == [f"made {kind}" for kind in KINDS]
    assert made_places([], tmp_path) == []
    assert all(len({part.name for part in place.parts}) == 2 for place in places)


def test_a_still_is_watched_by_a_camera_that_hardly_moves_and_judged_in_the_end(tmp_path: Path) -> None:
    root = tmp_path / "stills"
    root.mkdir()
    cv2.imwrite(str(root / "a.color.png"), np.full((48, 64, 3), 90, np.uint8))
    cv2.imwrite(str(root / "a.depth.png"), np.full((48, 64), 800, np.uint16))
    objects = [
        {"id": 1, "name": "cup", "rect": [1, 2, 30, 40], "reportable": True},
        {"id": 2, "name": "coin", "rect": [40, 2, 44, 6], "reportable": False},
    ]
    table = {"K": [60.0, 60.0, 32.0, 24.0], "depth_units_per_metre": 1000}
    images = [{"name": "a", "width": 64, "height": 48, "objects": objects}]
    (root / "table.json").write_text(json.dumps({**table, "images": images}))
    stills = StillSet("stills", "table.json", "{}.color.png", "{}.depth.png")
    ((name, folder, truth),) = still_parts(stills, tmp_path, tmp_path / "work")
    recording = open_recording(folder)
    assert (name, len(recording)) == ("stills-a", FRAMES)
    assert recording.read(3).depth_m[5, 5] == pytest.approx(0.8)
    first, last = (recording.read(k).T_world_camera for k in (0, FRAMES - 1))
    assert 0 < np.linalg.norm(first[:3, 3] - last[:3, 3]) < 0.01
    (frame,) = read_keyframes(truth).frames
    assert frame.frame == FRAMES - 1
    assert [item.visible >= 0.3 for item in frame.drawn] == [True, False]


def test_a_run_that_fails_gives_its_reason(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    place = Place("empty", "desk", 0.5, made=False, parts=(Part("empty", tmp_path / "empty", ()),))
    with ThreadPoolExecutor(1) as executor:
        ((done, reason),) = track(Checkout.of(SOURCE, tmp_path), [place], executor)
    assert done is place
    assert reason is not None
    assert "empty" in reason
    assert reason.count("\n") == 0


def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(PLACES), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def test_a_wrong_comparison_is_answered_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "no.json").write_text("{}")
    done = call("--work", str(tmp_path), "--against", str(tmp_path / "no.json"))
    assert done.returncode == 2
    assert done.stderr.startswith(f"places: {tmp_path / 'no.json'}: is no file written by --save")
    assert done.stderr.count("\n") == 1
