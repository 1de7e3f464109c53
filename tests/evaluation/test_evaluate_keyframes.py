from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from made_keyframes import drawn, keyframes_document, square, write_keyframes, write_sightings

from cuboid import cli, open_recording, open_results
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, Proposal3D, Sighting, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.inputs.readers import Recording
from cuboid.lab.evaluation import evaluate_keyframes
from cuboid.lab.evaluation.evaluate_keyframes import KeyframeEvaluation
from cuboid.results.files import ObjectsFile, ResultWriter, RunReport
from made_results import SKIPPED, write_results


def hand_computed(folder: Path) -> tuple[Path, Path]:
    """Three frames of two things, and a third thing that one of them hardly shows.

    Thing 1 is found in all three, under the labels 5, 5, 7; thing 2 in the first, under 7, with an IoU of only
    0.333 in the second, and never in the third. Label 9 is false in the first frame and lies in an ignored place in
    the second.
    """
    frames = {
        2: [drawn(1, square(0)), drawn(2, square(100))],
        4: [drawn(1, square(10)), drawn(2, square(110)), drawn(3, square(300), visible=0.1)],
        9: [drawn(1, square(20)), drawn(2, square(120))],
    }
    sightings = [
        (2, 5, square(0)), (2, 7, square(101)), (2, 9, square(500)),
        (4, 5, square(10)), (4, 7, square(115)), (4, 9, square(500)), (4, 4, square(300)),
        (9, 7, square(20)),
        (3, 5, square(0)),  # a frame that nobody drew on
    ]  # fmt: skip
    document = keyframes_document(frames, ignore={4: [square(490, side=40.0)]})
    return write_sightings(folder, sightings), write_keyframes(folder, document)


def test_the_figures_are_those_computed_by_hand(tmp_path: Path) -> None:
    found = evaluate_keyframes(*hand_computed(tmp_path))
    half, quarter = found.at
    # At 0.5: 1 in all three frames and 2 in the first, of 6 rectangles that count.
    assert (half.rectangles, half.found, half.recall) == (6, 4, pytest.approx(4 / 6))
    # False: 9 in frame 2, 7 in frame 4 (IoU a third). Neither way: 9 in frame 4, and 4 on what is hardly visible.
    assert (half.false, half.precision) == (2, pytest.approx(4 / 6))
    assert half.neither == {"ignored": 1, "hardly visible": 1, "in group": 0}
    assert (half.objects, half.objects_found) == (2, 2)
    # Only 1 was found more than once: 5, 5, 7.
    assert half.one_label == pytest.approx(2 / 3)
    # 1 with 5 agree twice, 2 with 7 once; 6 rectangles and 6 sightings that count.
    assert half.idf1 == pytest.approx(2 * 3 / 12)
    # At 0.25 the sighting of 2 in frame 4 counts too, under the label it had before.
    assert (quarter.found, quarter.false, quarter.recall, quarter.precision) == (5, 1, pytest.approx(5 / 6), 5 / 6)
    assert quarter.one_label == pytest.approx(4 / 5)
    assert quarter.idf1 == pytest.approx(2 * 4 / 12)
    assert [(item.id, item.rectangles, item.stages, item.labels) for item in found.objects] == [
        (1, 3, {"labelled": 3}, (5, 7)),
        (2, 3, {"labelled": 1}, (7,)),
    ]


def test_what_is_undefined_is_null_and_no_fault(tmp_path: Path) -> None:
    nothing = write_sightings(tmp_path, [])
    found = evaluate_keyframes(nothing, write_keyframes(tmp_path, keyframes_document({0: [drawn(1, square(0))]})))
    at = found.to_dict()["at"][0]
    assert (at["recall"], at["precision"], at["one_label"], at["idf1"]) == (0.0, None, None, 0.0)
    found = evaluate_keyframes(nothing, write_keyframes(tmp_path, keyframes_document({0: []})))
    assert (found.at[0].recall, found.at[0].objects, found.objects) == (None, 0, ())


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_results(tmp_path_factory.mktemp("run"))


def with_config(results: Path, folder: Path, **config: Any) -> Path:
    """Return a copy of results whose run.json says something else."""
    copy = folder / "results"
    copy.mkdir()
    for path in results.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    report = json.loads((copy / "run.json").read_text())
    if "frames_read" in config:
        read = config.pop("frames_read")
        report["frames"] = {"read": read, "used": read, "skipped": []}
    report["config"].update(config)
    (copy / "run.json").write_text(json.dumps(report))
    return copy


SEEN = [40.0, 30.0, 60.0, 60.0]  # the rectangle of every sighting in the made results, but for the best ones


def test_frames_that_the_run_was_not_given_are_not_judged(results: Path, tmp_path: Path) -> None:
    document = keyframes_document({frame: [drawn(2, SEEN)] for frame in (6, 8, 9, 16, 39)})
    sparse = with_config(results, tmp_path, every=4, limit=8, frames_read=8)  # 0, 4, ... 28
    found = evaluate_keyframes(sparse, write_keyframes(tmp_path, document))
    assert [frame.keyframe.frame for frame in found.frames] == [8, 16]
    assert found.not_given == (6, 9, 39)
    assert (found.at[0].rectangles, found.at[0].found) == (2, 2)
    none = write_keyframes(tmp_path, keyframes_document({9: [drawn(2, SEEN)]}))
    with pytest.raises(InputError, match=r"none of the frames of .*one in 4 of the first 32"):
        evaluate_keyframes(sparse, none)


def test_in_frames_that_the_run_skipped_everything_is_missed(results: Path, tmp_path: Path) -> None:
    skipped = min(SKIPPED)
    document = keyframes_document({frame: [drawn(2, SEEN)] for frame in (skipped, skipped + 1)})
    found = evaluate_keyframes(results, write_keyframes(tmp_path, document))
    assert found.skipped == (skipped,)
    assert (found.at[0].rectangles, found.at[0].found) == (2, 1)


def test_a_frame_beyond_the_recording_is_refused(results: Path, tmp_path: Path) -> None:
    document = keyframes_document({1220: [drawn(1, square(0))]})
    with pytest.raises(InputError, match=r"has frame 1220, .* at most 40 frames; 'frame' counts"):
        evaluate_keyframes(results, write_keyframes(tmp_path, document))


def test_the_file_that_a_frame_names_must_be_that_frame_s(results: Path, tmp_path: Path) -> None:
    document = keyframes_document({8: [drawn(2, SEEN)]})
    document["frames"][0]["number"] = 8
    assert evaluate_keyframes(results, write_keyframes(tmp_path, document)).at[0].found == 1
    document["frames"][0]["number"] = 27
    with pytest.raises(InputError, match=r"frame 8 is said to have the number 27, but .*color/000008\.png"):
        evaluate_keyframes(results, write_keyframes(tmp_path, document))


def test_without_the_recording_the_2d_proposals_have_a_reason(results: Path, tmp_path: Path) -> None:
    recording = results.parent / "recording"
    path = write_keyframes(tmp_path, keyframes_document({8: [drawn(2, SEEN)]}))
    document = json.loads((results / "run.json").read_text())
    lost = with_config(results, tmp_path, proposals="depth")
    text = json.dumps({**document, "recording": str(tmp_path / "gone"), "config": {"every": 1, "proposals": "depth"}})
    (lost / "run.json").write_text(text)
    first, *others = evaluate_keyframes(lost, path).funnel
    assert (first.name, first.at, first.per_frame) == ("2D proposals", (), None)
    assert "gone does not exist" in first.reason
    assert all(stage.at and not stage.reason for stage in others)
    assert evaluate_keyframes(lost, path, recording).funnel[0].reason == ""
    with pytest.raises(InputError, match="does not exist"):
        evaluate_keyframes(lost, path, tmp_path / "nowhere")


def test_a_source_without_a_name_cannot_be_asked_again(results: Path, tmp_path: Path) -> None:
    path = write_keyframes(tmp_path, keyframes_document({8: [drawn(2, SEEN)]}))
    own = with_config(results, tmp_path, proposals="MyDetector")
    assert "MyDetector" in evaluate_keyframes(own, path).funnel[0].reason
    assert "does not say" in evaluate_keyframes(results, path).funnel[0].reason


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"version": 2}, "expected format 'cuboid-keyframes' version 1"),
        ({"frames": []}, "has no frames"),
        ({"frames": [{"frame": 0}]}, r"frames\[0\]: field 'boxes' is missing"),
        ({"frames": [{"frame": -1, "boxes": []}]}, "expected a whole number of at least 0, got -1"),
        ({"frames": [{"frame": 0, "boxes": []}] * 2}, "frame 0 is there twice"),
        (
            {"frames": [{"frame": 3, "boxes": [drawn(1, [5, 0, 5, 9])]}]},
            r"frames\[0\].boxes\[0\]: expected a rectangle",
        ),
        ({"frames": [{"frame": 3, "boxes": [drawn(1, square(0))] * 2}]}, r"frames\[0\]: id 1 is there twice"),
        (
            {"frames": [{"frame": 3, "boxes": [drawn(1, square(0), visible=1.5)]}]},
            "visible: expected a number of at most 1",
        ),
        ({"frames": [{"frame": 3, "boxes": [], "ignore": [[1, 2, 3]]}]}, "expected a list of length 4"),
        ({"objects": [{"id": "a"}]}, "id: expected a whole number"),
        ({"objects": [{"id": 1}, {"id": 1}]}, "object id 1 is there twice"),
        ({"objects": None}, "objects: expected a list, got null"),
    ],
)
def test_bad_keyframes_are_one_line_that_says_where(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, Any], complaint: str
) -> None:
    path = write_keyframes(tmp_path, {**keyframes_document({0: [drawn(1, square(0))]}), **change})
    assert cli.main(["evaluate", str(write_sightings(tmp_path, [])), str(path)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert str(path) in line
    with pytest.raises(InputError, match=complaint):
        evaluate_keyframes(write_sightings(tmp_path, []), path)


def test_the_command_prints_what_is_found_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sightings, path = hand_computed(tmp_path)
    assert cli.main(["evaluate", str(sightings), str(path), "--json", str(tmp_path / "all.json")]) == 0
    shown = capsys.readouterr().out
    assert "3 keyframes judged, 6 rectangles of 2 objects to be found" in shown
    assert [line.split() for line in shown.splitlines() if line.strip().startswith("IoU 0.50")] == [
        ["IoU", "0.50", "0.667", "0.667", "4", "of", "6", "2", "2", "2", "of", "2", "0.667", "0.500", "-"]
    ]
    document = json.loads((tmp_path / "all.json").read_text())
    assert (document["format"], document["at"][1]["recall"]) == ("cuboid-keyframes-evaluation", 0.833333)
    assert document["frames"][0]["sightings"][2] == {"label": 9, "outcome": "false"}
    assert cli.main(["evaluate", str(sightings), str(path), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == document["frames"]


@pytest.mark.parametrize("option", [["--cloud", "x.ply"], ["--trajectory", "x.txt"], ["--pictures", "shown"]])
def test_options_that_do_not_go_with_it_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: list[str]
) -> None:
    sightings, path = hand_computed(tmp_path)
    assert cli.main(["evaluate", str(sightings), str(path), *option]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "shown").exists()


# Things of the real desk: in frame 184 of its 216 (file 001075) all of these are drawn, in 209 (001220) too.
FOUND_FRAMES, FOUND_IDS, FRAME_OWN_IDS = (184, 209), (9, 11), (9, 11, 14)
DEPTH_M = 1.0


def plate(rect: list[float], T_world_camera: np.ndarray, K: Intrinsics) -> Box:
    """A thin plate a metre before the camera that fills a rectangle of its picture."""
    x0, y0, x1, y1 = rect
    middle = np.array([(x0 + x1) / 2 - K.cx, (y0 + y1) / 2 - K.cy]) * DEPTH_M / (K.fx, K.fy)
    size = np.array([(x1 - x0) / K.fx * DEPTH_M, (y1 - y0) / K.fy * DEPTH_M, 1e-4])
    center = T_world_camera[:3, :3] @ (*middle, DEPTH_M) + T_world_camera[:3, 3]
    return Box(center, size, T_world_camera[:3, :3])


def made_desk_run(recording: Recording, rects: dict[int, dict[int, list[float]]], folder: Path) -> Path:
    """Write results: two things labelled in two frames, three as boxes of the frame, one in the map."""
    with ResultWriter(folder) as writer:
        for frame in range(len(recording)):
            T = recording.pose(frame)
            here = rects.get(frame, {}) if frame in FOUND_FRAMES else {}
            boxes = {number: plate(rect, T, recording.intrinsics) for number, rect in here.items()}
            seen = [Sighting(n, boxes[n], None, 1.0, np.array(here[n]) + 5.0) for n in FOUND_IDS if n in here]
            own = [Proposal3D(0, boxes[n], 0.5, np.array(here[n])) for n in FRAME_OWN_IDS if n in here]
            time_s = recording.timestamp_s(frame)
            writer.add(FrameResult(frame, time_s, T, tuple(seen), tuple(own), 2, np.zeros((4, 4), np.float32), {}))
        T = recording.pose(184)
        box = plate(rects[184][9], T, recording.intrinsics)
        thing = TrackedObject(9, box, 1.0, 1.0, 184, 209, 2, 10, np.zeros(3), None, ())
        config, count = {"every": 1, "limit": None, "scale": 2, "proposals": "depth:160"}, len(recording)
        report = RunReport("1", True, str(recording.path), "plain", "given", 1, config, count, count, (), {}, 1.0, 1.0)
        points = MapPoints(
            np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32), np.zeros(0, np.int32)
        )
        writer.finish(ObjectsFile(None, recording.intrinsics, (), (thing,)), points, report)
    return folder


@pytest.fixture(scope="module")
def desk(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Results of the real desk, and its keyframes."""
    if not (data_dir / "desk-realsense" / "keyframes.json").exists():
        pytest.skip(f"no desk-realsense in {data_dir}")
    path = data_dir / "desk-realsense" / "keyframes.json"
    truth = json.loads(path.read_text())
    rects = {item["frame"]: {box["id"]: box["rect"] for box in item["boxes"]} for item in truth["frames"]}
    folder = tmp_path_factory.mktemp("desk") / "results"
    return made_desk_run(open_recording(path.parent), rects, folder), path


def test_the_funnel_of_a_real_desk(desk: tuple[Path, Path]) -> None:
    found: KeyframeEvaluation = evaluate_keyframes(*desk)
    assert (len(found.frames), found.at[0].rectangles, found.not_given) == (7, 36, ())
    # Two things in two frames with their own labels.
    assert (found.at[0].found, found.at[0].false, found.at[0].objects_found) == (4, 0, 2)
    assert (found.at[0].one_label, found.at[0].precision) == (1.0, 1.0)
    assert found.at[0].idf1 == pytest.approx(2 * 4 / (36 + 4))
    two, three, mapped, labelled = found.funnel
    assert [stage.at[0].found for stage in (three, labelled)] == [6, 4]
    # The one box of the map lies where thing 9 is in frame 184; the poses put it into every other frame.
    assert [stage for stage in ("map",) if found.frames[5].stages[stage][0]] == ["map"]
    assert mapped.at[0].found >= 1
    # The proposals come from the recording, at the scale of the run, in pixels of the full size.
    assert two.per_frame > 10
    assert two.at[1].found >= two.at[0].found > 4


def test_pictures_show_what_is_missed(desk: tuple[Path, Path], tmp_path: Path) -> None:
    assert cli.main(["evaluate", *map(str, desk), "--pictures", str(tmp_path / "shown")]) == 0
    assert sorted(path.name for path in (tmp_path / "shown").iterdir())[-2:] == ["000184.jpg", "000209.jpg"]
    shown = cv2.imread(str(tmp_path / "shown" / "000184.jpg"))[:, :, ::-1].astype(int)
    assert shown.shape[1] == 640
    left = [tint_at(shown, 93, 250), tint_at(shown, 139, 130)]  # left sides of thing 9, found, and 10, missed
    assert left[0][1] > left[0][0] + 50  # green
    assert left[1][0] > left[1][1] + 50  # red


def tint_at(picture: np.ndarray, x: int, y: int) -> np.ndarray:
    """The most colored pixel of a few across a line."""
    row = picture[y, x - 3 : x + 4]
    return np.asarray(row[np.ptp(row, axis=1).argmax()])


def test_labels_get_the_name_of_the_thing_whose_first_label_they_are(tmp_path: Path) -> None:
    found = evaluate_keyframes(*hand_computed(tmp_path))
    # Thing 1 was found as 5, then as 7; thing 2 first as 7.
    assert found.names_by_label() == {5: "thing 1", 7: "thing 2"}


def test_drawn_names_reach_the_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = write_results(tmp_path)
    rect = [40.0, 30.0, 60.0, 60.0]  # of label 1 in frame 2, of label 2 in frame 25
    document = keyframes_document({2: [drawn(1, rect)], 25: [drawn(2, rect)]})
    keyframes = write_keyframes(tmp_path, document)
    assert cli.main(["evaluate", str(results), str(keyframes), "--give-names"]) == 0
    assert "2 objects named in" in capsys.readouterr().out
    named = {item.label: item.name for item in open_results(results).objects}
    assert (named[1], named[2], named[3]) == ("thing 1", "thing 2", None)
    truth = tmp_path / "sightings.csv"
    write_sightings(tmp_path, [(2, 1, rect)])
    assert cli.main(["evaluate", str(truth), str(keyframes), "--give-names"]) == 2
    assert "only objects of results of 'cuboid track' can be named" in capsys.readouterr().err
