"""Evaluation of labels and changes over several visits of one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.results import SceneChange
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.visits_file import ChangeOfThing, VisitsDocument
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix, pack
from cuboid.lab.evaluation.alignment import TRUE_TRAJECTORY, motion_to_truth
from cuboid.lab.evaluation.matching import match, ratio
from cuboid.lab.evaluation.truth import read_truth
from cuboid.runs.scene import Scene

VISITS = "visits.json"
# Minimum IoU of the boxes of a label and an object that belong together.
MIN_IOU = 0.2
# Minimum number of frames that show an object, or its empty place, for it to be judged.
SHOWN_FRAMES = 8
JUDGED_CHANGES = ("moved", "gone", "new")


@dataclass(frozen=True, slots=True)
class VisitsQuality:
    """Counts of correct answers over all pairs of consecutive visits.

    Attributes
    ----------
    unmoved, kept : int
        Objects that were found and did not move, and those among them that kept their label.
    moved, recognised : int
        Objects that were found and moved in sight, and those among them that kept their label and are reported as
        moved.
    changes, reported, right : int
        True changes (moved, gone, new), reported ones, and correctly reported ones.
    hidden_called_gone : int
        Objects reported as gone although no frame shows their place empty.
    """

    unmoved: int
    kept: int
    moved: int
    recognised: int
    changes: int
    reported: int
    right: int
    hidden_called_gone: int

    def to_dict(self) -> dict[str, Any]:
        """Return the counts and their ratios."""
        return {
            **asdict(self),
            "kept_share": ratio(self.kept, self.unmoved),
            "recognised_share": ratio(self.recognised, self.moved),
            "precision": ratio(self.right, self.reported),
            "recall": ratio(self.right, self.changes),
        }


def is_visits(path: Path) -> bool:
    """Return whether a folder contains the truth of several visits."""
    return (path / VISITS).is_file()


def evaluate_visits(scene: PathLike, folder: PathLike) -> VisitsQuality:
    """Evaluate a scene whose recordings are the visits in a folder, in order.

    Parameters
    ----------
    scene : path
        The scene file.
    folder : path
        Output of `cuboid synth --visits`.

    Raises
    ------
    InputError
        The scene or the folder cannot be read, or the scene has other recordings.
    """
    folder = as_path(folder)
    visits = read_json(folder / VISITS, VisitsDocument).visits
    with Scene.open(scene) as opened:
        if len(opened.recordings) != len(visits):
            raise InputError(f"{scene}: has {len(opened.recordings)} recordings, expected {len(visits)} visits")
        T_truth_scene = _T_truth_scene(opened, folder / visits[0].recording)
        labels = [_labels(opened, k, folder / visit.recording, T_truth_scene) for k, visit in enumerate(visits, 1)]
        survivor = {item.label: item.merged_into or item.label for item in opened.all_objects}
        counts = np.zeros(8, int)
        for k in range(1, len(visits)):
            reported = [change for change in opened.changes(k + 1) if change.recording == k + 1]
            counts += _pair(visits[k].changes, labels[k - 1], labels[k], reported, survivor)
    return VisitsQuality(*counts.tolist())


def _T_truth_scene(scene: Scene, first: Path) -> Float64Array:
    """Return the transform from the scene's world, that of its first recording, to the truth's."""
    if scene.recordings[0].poses == "given":
        return np.eye(4)
    return motion_to_truth(first / TRUE_TRAJECTORY, scene.poses(1).values(), "the scene's first recording")


def _labels(scene: Scene, number: int, folder: Path, T_truth_scene: Float64Array) -> dict[int, int]:
    """Return the label of each object in a visit, by id, from the boxes at its end."""
    truth = read_truth(folder)
    changes = scene.changes(number)
    gone = {change.label for change in changes if change.recording == number and change.change == "gone"}
    boxes: dict[int, Box] = {}
    for item in scene.all_objects:
        if item.merged_into is None and item.state != "forgotten" and item.label not in gone:
            # Objects that were merged into it later had their own labels and boxes then.
            boxes |= {past.label: past.box for past in scene.history(item.label) if past.recording == number}
    if not boxes:
        return {}
    found = [box.moved(T_truth_scene) for box in boxes.values()]
    iou = iou_matrix(pack([item.box for item in truth.objects]), pack(found))
    numbers = list(boxes)
    return {truth.objects[i].id: numbers[j] for i, j in match(iou, MIN_IOU)}


def _pair(
    truth: Sequence[ChangeOfThing],
    before: dict[int, int],
    after: dict[int, int],
    reported: list[SceneChange],
    survivor: dict[int, int],
) -> list[int]:
    """Return the counts of `VisitsQuality` for two visits."""
    unmoved = kept = moved = recognised = changes = right = hidden = 0
    kind_of = {change.label: change.change for change in reported}
    id_before, id_after = (
        {survivor.get(label, label): number for number, label in labels.items()} for labels in (before, after)
    )
    judged = {row.id: row for row in truth if row.judged}
    for number, row in judged.items():
        old, new = (survivor.get(labels.get(number, 0), labels.get(number)) for labels in (before, after))
        seen, empty = row.seen_frames >= SHOWN_FRAMES, row.empty_frames >= SHOWN_FRAMES
        if row.change == "unchanged" and seen and old is not None:
            unmoved += 1
            kept += old == new
        if row.change == "moved" and seen and empty:
            changes += 1
            if old is not None:
                moved += 1
                hit = old == new and kind_of.get(old) == "moved"
                recognised += hit
                right += hit
        if row.change == "gone" and empty and old is not None:
            changes += 1
            right += kind_of.get(old) == "gone"
        if row.change == "new" and seen:
            changes += 1
            right += new is not None and kind_of.get(new) == "new"
    others = {row.id for row in truth} - judged.keys()
    counted = 0
    for change in reported:
        true_id = id_before.get(change.label, id_after.get(change.label))
        if change.change in JUDGED_CHANGES and true_id not in others:
            counted += 1
        if change.change == "gone" and true_id in judged:
            row = judged[true_id]
            hidden += row.empty_frames < SHOWN_FRAMES
    return [unmoved, kept, moved, recognised, changes, counted, right, hidden]
