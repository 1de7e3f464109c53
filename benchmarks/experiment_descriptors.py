"""Matching by IoU of boxes against matching by 3D features, of the same clusters.

Each frame's clusters are those of the tracker. A plain tracker gives each cluster a label: the object of the map that
it is most like, one to one, or a new one. Likeness is the IoU of its box with the object's (fitted to all points that
the object got so far), or the fraction of its keypoints whose nearest feature in the map, within a radius, is the
object's. Nothing but labels differs between the methods; what is scored are the frames' own boxes.

The least likeness of a match, and the radius, are those with the best IDF1 on a `clutter` and a `table` scene of
seed 11; they are used on other scenes. The map is filled up to so many objects with clusters of other recordings.
Times are those of the processor, medians over frames.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.method.objects.matching import assign
from features import FEATURES, KEYPOINTS, make_surface
from memories import KEPT, Boxes, Features
from observations import Observation, Observed, as_result, observe
from scenes import Case, MadeScene, cases, made
from scoring import mean, score, total
from tables import cell, dump, show

TUNING = (("clutter", 11), ("table", 11))
FILLING = tuple(product(("table", "clutter", "tables", "room"), (3, 4)))
LIKENESS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
# Radii that are tried, as quantiles of the distance between features of a cluster and those of another view of it.
RADII = (0.5, 0.8, 0.95)


class Filling(NamedTuple):
    """A cluster that fills the map: its box, put elsewhere, and a view of it by each feature."""

    box: Box
    features: dict[str, list[Float64Array]]


class Setting(NamedTuple):
    """A method with its parameters."""

    method: str
    least: float
    radius: float

    def memory(self) -> Boxes | Features:
        """Return an empty map."""
        return Boxes() if self.method == "IoU" else Features(self.method, self.radius)


def label_all(
    seen: Sequence[Observed], setting: Setting, filling: Sequence[Filling], known: Sequence[list[Any]] | None = None
) -> tuple[list[tuple[int, int, Box]], dict[str, float]]:
    """Give every cluster of a recording a label.

    Parameters
    ----------
    seen : sequence of Observed
    setting : Setting
    filling : sequence of Filling
        Objects that the map holds from the start.
    known : sequence of list, optional
        What `describe` would return for each frame, to save time where it is not measured.

    Returns
    -------
    list of (int, int, Box)
        Frame, label, the frame's own box.
    dict of str to float
        Median milliseconds a frame of description and matching, bytes an object.
    """
    memory = setting.memory()
    for number, item in enumerate(filling):
        views = [pack([item.box])] if setting.method == "IoU" else item.features[setting.method]
        for view in views:
            memory.learn(number, None, view)
    objects, rows, times = len(filling), [], []
    for k, frame in enumerate(seen):
        if not frame.clusters:
            continue
        begun = time.process_time()
        described = memory.describe(frame) if known is None else known[k]
        after = time.process_time()
        partner = dict(assign(memory.likeness(described), setting.least)) if objects else {}
        done = time.process_time()
        times.append((after - begun, done - after))
        for i, cluster in enumerate(frame.clusters):
            number = partner.get(i, objects)
            objects = max(objects, number + 1)
            memory.learn(number, cluster, described[i])
            rows.append((frame.frame, number + 1, cluster.box))
    describe_ms, match_ms = np.median(np.array(times), axis=0) * 1e3
    return rows, {
        "describe_ms": float(describe_ms),
        "match_ms": float(match_ms),
        "kb_object": memory.bytes_an_object() / 1024,
    }


def judge(case: Case, seen: Sequence[Observed], rows: list[tuple[int, int, Box]]) -> dict[str, Any]:
    """Return the figures of labels."""
    return score(case, as_result([frame.frame for frame in seen], rows))


def tune(method: str, work: Path, every: int) -> Setting:
    """Return the parameters with the best mean IDF1 on the scenes for tuning."""
    scenes = [made(MadeScene(kind, seed), work) for kind, seed in TUNING]
    seen = [observe(case, every) for case in scenes]
    radii, known = (0.0,), [None] * len(seen)
    if method != "IoU":
        memory = Features(method, 0.0)
        known = [[memory.describe(frame) for frame in frames] for frames in seen]
        gaps = [between(a, b) for frames in known for a, b in pairwise(frames)]
        radii = tuple(np.quantile(np.concatenate(gaps), RADII).tolist())
    best, chosen = -1.0, None
    for least, radius in product(LIKENESS, radii):
        setting = Setting(method, least, radius)
        found = [
            judge(case, frames, label_all(frames, setting, (), described)[0])
            for case, frames, described in zip(scenes, seen, known, strict=True)
        ]
        value = mean(found, "idf1_25") or 0.0
        if value > best:
            best, chosen = value, setting
    assert chosen is not None
    return chosen


def between(first: list[Float64Array], second: list[Float64Array]) -> Float64Array:
    """Return the distance from each feature of a frame to the nearest of the next frame."""
    if not first or not second:
        return np.zeros(0)
    a, b = np.concatenate(first), np.concatenate(second)
    square = (a**2).sum(1)[:, None] - 2.0 * (a @ b.T) + (b**2).sum(1)[None]
    return np.sqrt(np.maximum(square.min(1), 0.0))


def fillings(count: int, work: Path, every: int) -> list[Filling]:
    """Return objects of other recordings, each by four of its views; the same thing seen from elsewhere is another."""
    kept: list[Filling] = []
    views = KEPT // KEYPOINTS
    for kind, seed in FILLING:
        by_label: dict[int, list[tuple[Observed, Observation]]] = {}
        for frame in observe(made(MadeScene(kind, seed), work), every):
            for cluster in frame.clusters:
                if cluster.label:
                    by_label.setdefault(cluster.label, []).append((frame, cluster))
        for sightings in by_label.values():
            for start in range(0, len(sightings) - views + 1, views):
                some = sightings[start : start + views]
                surfaces = [make_surface(c.points, c.pixels, f.width, f.eye) for f, c in some]
                features = {name: [compute(s) for s in surfaces] for name, (_, compute) in FEATURES.items()}
                kept.append(Filling(_elsewhere(some[0][1].box, len(kept)), features))
                if len(kept) == count:
                    return kept
    print(f"note: the recordings give {len(kept)} objects to fill the map with, {count} were asked for")
    return kept


def _elsewhere(box: Box, number: int) -> Box:
    """Return the box at a place of its own, 100 m away, a square metre each."""
    place = np.array([100.0 + number % 32, 100.0 + number // 32, 0.0])
    return Box(place, box.size, box.rotation)


def experiment(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Return a row for each method and number of objects: sums and means over the scenes."""
    scenes = cases(args.kinds, args.seeds, args.work, args.data)
    args.scenes = [case.name for case in scenes]
    seen = [observe(case, args.every, args.limit) for case in scenes]
    filling = fillings(max(args.objects), args.work, args.every)
    rows = []
    for method in ("IoU", *FEATURES):
        setting = tune(method, args.work, args.every)
        for count in args.objects:
            found = []
            for case, frames in zip(scenes, seen, strict=True):
                labels, costs = label_all(frames, setting, filling[: max(0, count - 10)])
                found.append(judge(case, frames, labels) | costs)
            rows.append(summary(method, count, setting, found))
    own = [
        judge(case, frames, [(f.frame, c.label, c.box) for f in frames for c in _once(f.clusters)])
        for case, frames in zip(scenes, seen, strict=True)
    ]
    return [*rows, summary("the tracker itself", 0, None, own)]


def _once(clusters: Sequence[Observation]) -> list[Observation]:
    """Return the labelled clusters, of each label the largest."""
    largest: dict[int, Observation] = {}
    for cluster in sorted(clusters, key=lambda c: len(c.points)):
        largest[cluster.label] = cluster
    return [cluster for label, cluster in sorted(largest.items()) if label]


def summary(method: str, count: int, setting: Setting | None, found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return one row of all scenes."""
    names = ("idf1_25", "ass_a", "purity", "consistency", "describe_ms", "match_ms", "kb_object")
    return {
        "method": method,
        "objects": count or None,
        "setting": None if setting is None else setting._asdict(),
        "switches": total(found, "switches"),
        "labels": total(found, "proposals"),
        "reappearances": total(found, "reappearances"),
        "same_label": total(found, "same_label"),
        **{name: mean(found, name) for name in names},
    }


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    rows = experiment(args)
    if args.json:
        dump(rows)
        return
    header = (
        "matching by",
        "objects",
        "IDF1 .25",
        "AssA",
        "purity",
        "consistency",
        "switches",
        "labels given",
        "re-id",
        "describe ms",
        "match ms",
        "kB an object",
        "MB of all",
    )
    lines = [
        [
            row["method"],
            row["objects"],
            *(row[name] for name in ("idf1_25", "ass_a", "purity", "consistency", "switches", "labels")),
            f"{row['same_label']} of {row['reappearances']}",
            cell(row["describe_ms"], 2),
            cell(row["match_ms"], 2),
            cell(row["kb_object"], 2),
            None if row["kb_object"] is None else cell(row["kb_object"] * row["objects"] / 1024, 2),
        ]
        for row in rows
    ]
    show(f"Labels of the same clusters, over {', '.join(args.scenes)}", header, lines)
