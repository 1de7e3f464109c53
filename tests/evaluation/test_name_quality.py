from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from cuboid.lab.evaluation.names import class_of, name_quality
from cuboid.method.detection.vocabulary import COCO
from cuboid.results.files.objects import read_objects, write_objects
from made_results import made_objects, write_results


@pytest.mark.parametrize(
    ("name", "of"),
    [
        ("monitor, left (desk)", "tv"),
        ("keyboard, black (below the monitor behind)", "keyboard"),
        ("mouse, small (next to the keyboard)", "mouse"),
        ("mug, white and red", "cup"),
        ("glass bowl with pens", "bowl"),
        ("book 'Multiple View Geometry'", "book"),
        ("clock on the wall", "clock"),
        ("two chairs", "chair"),
        ("exercise ball, grey", "sports ball"),
        ("earbud charging case, white", None),
        ("milk carton", None),
        ("telephone with its handset", None),
        ("jackets: grey puffer and navy/red garment, one pile", None),
    ],
)
def test_the_kind_of_what_people_write(name: str, of: str | None) -> None:
    assert class_of(name, COCO) == of


def named_results(folder: Path, vocabulary: list[str]) -> Path:
    """Object 1 is a cup by the detector, 2 a book though it is a cup, 3 has no name but a guess."""
    folder = write_results(folder)
    found = read_objects(folder / "objects.json")
    given = {
        1: {"name": "cup", "name_score": 0.9, "names": (("book", 0.05),)},
        2: {"name": "book", "name_score": 0.6, "names": (("bowl", 0.2), ("cup", 0.1))},
        3: {"names": (("tv", 0.3),)},
    }
    objects = tuple(dataclasses.replace(item, **given.get(item.label, {})) for item in found.objects)  # type: ignore[arg-type]
    write_objects(folder / "objects.json", dataclasses.replace(found, objects=objects))
    run = json.loads((folder / "run.json").read_text())
    run["config"]["vocabulary"] = vocabulary
    (folder / "run.json").write_text(json.dumps(run))
    return folder


def test_accuracy_top_three_and_confusion(tmp_path: Path) -> None:
    assert {item.label for item in made_objects()} >= {1, 2, 3}
    folder = named_results(tmp_path / "out", [*COCO])
    truth = [(10, "mug, red", 1), (11, "cup", 2), (12, "monitor", 3), (13, "bowl", None), (14, "lamp", 1)]
    found = name_quality(folder, truth)
    assert (found.judged, found.named, found.right, found.in_top) == (3, 2, 1, 3)
    assert found.accuracy == pytest.approx(1 / 3)
    assert found.top3 == 1.0
    assert found.precision == 0.5
    pairs = {(one.true_class, one.found_class): one.count for one in found.confusion}
    assert pairs == {("cup", "cup"): 1, ("cup", "book"): 1, ("tv", None): 1}


def test_results_without_a_detector_have_no_names_to_judge(tmp_path: Path) -> None:
    folder = named_results(tmp_path / "out", [])
    assert name_quality(folder, [(10, "mug", 1)]) is None
    assert name_quality(tmp_path / "rects.csv", [(10, "mug", 1)]) is None
