"""2D proposal sources on real frames: recall and precision at IoU 0.5, boxes a frame, milliseconds a frame.

python benchmarks/proposal_sources.py DATA [--sources NAME[:OPTIONS] ...] [--best N] [--every N] [--json]

DATA holds the folders `hots` (table-top stills with instance masks) and `rgbd-scenes-v2` (scene 01 with its truth).
`recall` counts, on hots, the objects of at least 3 cm height and 800 pixels that the border does not cut; on scene 01,
the true boxes at least half visible, as the rectangles of their projections in every 20th frame. `precision` is the
share of proposals that fit any listed object: chairs and sofas, which are not listed, count against it. `mask recall`
is for sources with masks, at a mask IoU of 0.5.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from cuboid import open_recording
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.lab.evaluation.truth import read_truth
from cuboid.method.proposals import Proposals, ProposalSource, make_source

FIT = 0.5
VISIBLE = 0.5
SOURCES = ("depth", "edgeboxes", "selective-search", "bing")


class View(NamedTuple):
    """A frame, its camera, and the objects in it: rectangles, which of them must be found, instance masks or none."""

    frame: Frame
    intrinsics: Intrinsics
    rectangles: np.ndarray
    wanted: np.ndarray
    ids: np.ndarray
    instances: np.ndarray | None


def stills(folder: Path) -> Iterator[View]:
    """Yield the stills of hots."""
    table = json.loads((folder / "objects.json").read_text())
    for still in table["images"]:
        intrinsics = Intrinsics(*table["K"], still["width"], still["height"])
        color = cv2.imread(str(folder / still["color"]))[..., ::-1]
        depth = cv2.imread(str(folder / f"{still['name']}.depth.png"), cv2.IMREAD_UNCHANGED)
        depth_m = (depth / table["depth_units_per_metre"]).astype(np.float32)
        yield View(
            Frame(0, 0.0, np.ascontiguousarray(color), depth_m),
            intrinsics,
            np.array([thing["rect"] for thing in still["objects"]], np.float64).reshape(-1, 4),
            np.array([thing["reportable"] for thing in still["objects"]], bool),
            np.array([thing["id"] for thing in still["objects"]]),
            cv2.imread(str(folder / f"{still['name']}.mask.png"), cv2.IMREAD_UNCHANGED),
        )


def scene(folder: Path, every: int) -> Iterator[View]:
    """Yield every so many frames of scene 01 with the rectangles of its truth."""
    recording = open_recording(folder / "imgs" / "scene_01")
    truth = read_truth(folder / "ground_truth" / "01.json")
    camera = recording.intrinsics
    limits = [camera.width, camera.height] * 2
    for index in range(0, len(recording), every):
        frame = recording.read(index)
        rectangles = []
        for thing, visible in zip(truth.objects, truth.visibility[index], strict=True):
            if visible >= VISIBLE:
                corners = camera.pixels(transform(inverse(frame.T_world_camera), thing.box.corners()))
                rectangles.append(np.clip([*corners.min(0), *corners.max(0)], 0, limits))
        boxes = np.array(rectangles).reshape(-1, 4)
        yield View(frame, camera, boxes, np.ones(len(boxes), bool), np.zeros(len(boxes)), None)


def rectangle_iou(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the IoU of each of (N, 4) with each of (M, 4)."""
    low = np.maximum(one[:, None, :2], other[None, :, :2])
    high = np.minimum(one[:, None, 2:], other[None, :, 2:])
    both = np.prod(np.maximum(high - low, 0), axis=-1)
    areas = [np.prod(x[:, 2:] - x[:, :2], axis=-1) for x in (one, other)]
    return both / np.maximum(areas[0][:, None] + areas[1][None] - both, 1e-9)


def mask_fits(proposals: Proposals, instance: np.ndarray) -> bool:
    """Whether some proposal's mask has IoU 0.5 with an instance's."""
    total = int(instance.sum())
    for (x0, y0, x1, y1), mask in zip(proposals.boxes_xyxy, proposals.full_masks() or (), strict=True):
        both = int((instance[y0:y1, x0:x1] & (mask > 0)).sum())
        if both >= FIT * (total + int(mask.sum()) - both):
            return True
    return False


def best(proposals: Proposals, count: int | None) -> Proposals:
    """Return the first proposals; sources give the best first."""
    masks = proposals.masks if proposals.masks is None else proposals.masks[:count]
    return Proposals(proposals.boxes_xyxy[:count], proposals.scores[:count], masks, proposals.mask_step)


def judge(source: ProposalSource, views: list[View], count: int | None) -> dict[str, float | None]:
    """Return what a source gives on the views."""
    found = wanted = masked = fitting = proposed = 0
    has_masks = False
    times = []
    source(views[0].frame, views[0].intrinsics)  # loads, compiles
    for view in views:
        start = time.perf_counter()
        given = source(view.frame, view.intrinsics)
        times.append((time.perf_counter() - start) * 1e3)
        given = best(given, count)
        fits = rectangle_iou(given.boxes_xyxy.astype(np.float64), view.rectangles) >= FIT
        proposed += len(given)
        fitting += int(fits.any(axis=1).sum())
        wanted += int(view.wanted.sum())
        found += int(fits.any(axis=0)[view.wanted].sum())
        has_masks |= given.masks is not None and view.instances is not None
        if given.masks is not None and view.instances is not None:
            masked += sum(mask_fits(given, view.instances == k) for k in view.ids[view.wanted])
    return {
        "recall": found / wanted,
        "mask_recall": masked / wanted if has_masks else None,
        "precision": fitting / max(1, proposed),
        "boxes": proposed / len(views),
        "ms": statistics.median(times),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--sources", nargs="+", default=None, metavar="NAME[:OPTIONS]")
    parser.add_argument("--best", type=int, default=None, metavar="N", help="judge the N best of a frame alone")
    parser.add_argument("--every", type=int, default=20, metavar="N", help="frames of scene 01 (default: 20)")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)
    names = args.sources or [f"bing:{args.data / 'bing-model'}" if name == "bing" else name for name in SOURCES]
    sets = {
        "hots": list(stills(args.data / "hots")),
        "scene 01": list(scene(args.data / "rgbd-scenes-v2", args.every)),
    }
    rows = [
        {"source": name.partition(":")[0], "data": data, **judge(make_source(name), views, args.best)}
        for data, views in sets.items()
        for name in names
    ]
    if args.json:
        print(json.dumps(rows, indent=1))
        return
    print("| data | source | recall | mask recall | precision | boxes a frame | ms a frame |")
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        mask = "" if row["mask_recall"] is None else f"{row['mask_recall']:.3f}"
        print(
            f"| {row['data']} | {row['source']} | {row['recall']:.3f} | {mask} "
            f"| {row['precision']:.3f} | {row['boxes']:.0f} | {row['ms']:.1f} |"
        )


if __name__ == "__main__":
    main()
