"""Fit the score of regions: boosted trees that tell whether a region of a picture is one whole thing.

python benchmarks/fit_regions.py PICTURES [--seed N] [--trees N] [--write]

PICTURES is a folder of `benchmarks/pictures/picture_scenes.py`: made pictures with masks, whose meshes have permissive
licences. No picture of a place that judges the program is used. Each candidate of a picture (`RegionSource.candidates`)
is a case: its quantities, and its largest IoU with the mask of a thing. The target rises from 0 at an IoU of .4 to 1 at
.7; all pictures have the same weight. LightGBM fits the trees (`pip install lightgbm`); the same seed gives the same
bytes. `--write` replaces `method/proposals/regions.npz`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.method.proposals import forest
from cuboid.method.proposals.forest import Forest
from cuboid.method.proposals.kernels import forest as kernels
from cuboid.method.proposals.kernels.quantities import QUANTITIES
from cuboid.method.proposals.region_maps import ReducedFrame
from cuboid.method.proposals.regions import MIN_LOG_ODDS, Masks, RegionSource, RegionTree
from region_pictures import IGNORED, STRUCTURE, MaskedPicture, made_pictures

# IoU with a thing at which the target is 0, and 1.
WRONG_IOU, RIGHT_IOU = 0.4, 0.7
# Largest number of wrong candidates of a picture: a sample, with the weight of all.
WRONG_PER_PICTURE = 250
TREES, LEAVES, RATE = 400, 47, 0.08
# A candidate counts neither way if at least this fraction of it is ignored.
IGNORED_FRACTION = 0.5
NO_FOREST = Forest(
    0.0, *(np.zeros(0, kind) for kind in (np.int32, np.int16, np.float32, np.int32, np.int32, np.float32))
)
# Fraction of the regions probable enough to be chosen that may be given up early, at each stage.
GIVEN_UP = 0.001


def cases_of(picture: MaskedPicture, source: RegionSource) -> tuple[Float32Array, Float64Array]:
    """Return the quantities (N, Q) of the usable candidates of a picture, and their IoU with things (N,)."""
    reduced = ReducedFrame(picture.frame, picture.intrinsics)
    (trees, surfaces), step = source.candidates(reduced), reduced.step
    height, width = trees[0].labels.shape
    middle = slice(step // 2, None, step)
    names = np.unique(picture.ids)
    things = names[(names != STRUCTURE) & (names != IGNORED)]
    column = np.zeros(IGNORED + 1, np.int64)
    column[things], column[IGNORED] = np.arange(1, len(things) + 1), len(things) + 1
    ids = column[picture.ids[middle, middle][:height, :width]]
    sizes = np.bincount(ids.ravel(), minlength=len(things) + 2)
    counts = [_tree_counts(tree, ids, len(sizes)) for tree in trees] + [_mask_counts(surfaces.masks, ids, len(sizes))]
    found = np.concatenate([*(tree.found for tree in trees), surfaces.found])
    usable = np.concatenate([*(tree.usable for tree in trees), surfaces.usable]) > 0
    common = np.concatenate(counts)
    pixels = np.maximum(common.sum(1, keepdims=True), 1)
    iou = (common[:, 1:-1] / (pixels + sizes[1:-1] - common[:, 1:-1])).max(1, initial=0.0)
    usable &= common[:, -1] < IGNORED_FRACTION * pixels[:, 0]
    return found[usable], iou[usable]


def _tree_counts(tree: RegionTree, ids: npt.NDArray[np.int64], columns: int) -> Float64Array:
    """Return the pixels of each region of a tree in each thing, (count, columns)."""
    counts = np.zeros((tree.count, columns))
    np.add.at(counts, (tree.labels, ids), 1.0)
    for k in range(tree.leaves, tree.count):
        counts[k] = counts[tree.tree.parts[k]].sum(0)
    return counts


def _mask_counts(masks: Masks, ids: npt.NDArray[np.int64], columns: int) -> Float64Array:
    """Return the pixels of each mask in each thing, (M, columns)."""
    counts = np.zeros((len(masks.rectangles), columns))
    for k, (x0, y0, x1, y1) in enumerate(masks.rectangles.tolist()):
        inside = masks.flat[masks.starts[k] :][: (x1 - x0) * (y1 - y0)] > 0
        counts[k] = np.bincount(ids[y0:y1, x0:x1].ravel()[inside], minlength=columns)
    return counts


def sampled(folder: Path, seed: int) -> Iterator[tuple[Float32Array, Float64Array, Float64Array]]:
    """Iterate over the pictures: quantities, targets and weights of a sample of their candidates."""
    source, random = RegionSource(TrackerConfig(), NO_FOREST), np.random.default_rng(seed)
    for n, picture in enumerate(made_pictures(folder)):
        found, iou = cases_of(picture, source)
        right, wrong = np.flatnonzero(iou > WRONG_IOU), np.flatnonzero(iou <= WRONG_IOU)
        weight = max(1.0, len(wrong) / WRONG_PER_PICTURE)
        if len(wrong) > WRONG_PER_PICTURE:
            wrong = np.sort(random.choice(wrong, WRONG_PER_PICTURE, replace=False))
        target = np.clip((iou - WRONG_IOU) / (RIGHT_IOU - WRONG_IOU), 0.0, 1.0)
        kept = np.concatenate([right, wrong])
        yield found[kept], target[kept], np.concatenate([np.ones(len(right)), np.full(len(wrong), weight)])
        if n % 100 == 99:
            print(f"{n + 1} pictures", file=sys.stderr, flush=True)


def fit(cases: list[tuple[Float32Array, Float64Array, Float64Array]], trees: int, seed: int) -> Forest:
    """Fit boosted trees to the cases of all pictures."""
    import lightgbm

    found, target, weight = (np.concatenate(parts) for parts in zip(*cases, strict=True))
    options: dict[str, Any] = {
        "objective": "cross_entropy",
        "num_leaves": LEAVES,
        "learning_rate": RATE,
        "min_data_in_leaf": 60,
        "feature_fraction": 0.5,
        "bagging_fraction": 0.7,
        "bagging_freq": 1,
        "lambda_l2": 5.0,
        "max_bin": 127,
        "seed": seed,
        "num_threads": 1,
        "deterministic": True,
        "verbose": -1,
    }
    booster = lightgbm.train(options, lightgbm.Dataset(found, target, weight=weight), trees)
    return as_forest(booster.dump_model()["tree_info"])


def as_forest(fitted: list[dict[str, Any]]) -> Forest:
    """Return the trees of LightGBM as arrays."""
    roots, nodes = [], []
    for tree in fitted:
        roots.append(len(nodes))
        _add_node(tree["tree_structure"], nodes)
    columns = zip(*nodes, strict=True)
    kinds = (np.int16, np.float32, np.int32, np.int32)
    arrays = [np.array(column, kind) for column, kind in zip(columns, kinds, strict=True)]
    return Forest(0.0, np.array(roots, np.int32), *arrays, np.zeros(0, np.float32))


def _add_node(node: dict[str, Any], nodes: list[tuple[int, float, int, int]]) -> int:
    """Add a node and those below it; return its number."""
    number = len(nodes)
    if "leaf_value" in node:
        nodes.append((-1, node["leaf_value"], 0, 0))
        return number
    nodes.append((0, 0.0, 0, 0))
    smaller, larger = _add_node(node["left_child"], nodes), _add_node(node["right_child"], nodes)
    # Rounded up, so that a value that LightGBM puts on the left side stays there.
    threshold = np.float32(node["threshold"])
    if threshold < node["threshold"]:
        threshold = np.nextafter(threshold, np.float32(np.inf))
    nodes[number] = (node["split_feature"], float(threshold), smaller, larger)
    return number


def with_stages(model: Forest, found: Float32Array) -> Forest:
    """Return a forest with `least` for the regions with quantities (N, Q): a soft cascade (Bourdev, Brandt 2005)."""
    every, count = kernels.STAGE, len(model.roots)
    usable, sums = np.ones(len(found), np.uint8), np.empty((count // every, len(found)))
    for k, last in enumerate(range(every, count + 1, every)):
        kernels.log_odds(found, usable, model._replace(roots=model.roots[:last]), model.least, sums[k])
    probable = sums[-1] >= MIN_LOG_ODDS
    least = np.quantile(sums[:-1, probable], GIVEN_UP, axis=1)
    return model._replace(least=least.astype(np.float32))


def save(model: Forest, path: Path) -> None:
    """Write a forest as `fitted_forest` reads it."""
    np.savez_compressed(path, quantities=np.array(QUANTITIES), **model._asdict())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", type=Path, metavar="PICTURES", help="folder of made pictures")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the samples and of the fit")
    parser.add_argument("--trees", type=int, default=TREES, metavar="N", help="number of trees")
    parser.add_argument(
        "--cases", type=Path, default=None, metavar="FILE", help="keep the cases, or read them if there"
    )
    parser.add_argument("--write", action="store_true", help="replace the trees in the source")
    args = parser.parse_args()
    cases = _cases(args)
    model = with_stages(fit(cases, args.trees, args.seed), np.concatenate([found for found, _, _ in cases]))
    print(f"{len(cases)} pictures, {sum(len(one[1]) for one in cases)} candidates, {len(model.roots)} trees")
    if args.write:
        save(model, Path(forest.__file__).with_name(forest.FILE))
    return 0


def _cases(args: argparse.Namespace) -> list[tuple[Float32Array, Float64Array, Float64Array]]:
    if args.cases is not None and args.cases.is_file():
        with np.load(args.cases) as kept:
            cuts = np.cumsum(kept["counts"])[:-1]
            return list(zip(*(np.split(kept[name], cuts) for name in ("found", "target", "weight")), strict=True))
    cases = list(sampled(args.pictures, args.seed))
    if args.cases is not None:
        joined = [np.concatenate(parts) for parts in zip(*cases, strict=True)]
        counts = np.array([len(one[1]) for one in cases])
        np.savez(args.cases, **dict(zip(("found", "target", "weight"), joined, strict=True)), counts=counts)
    return cases


if __name__ == "__main__":
    sys.exit(main())
