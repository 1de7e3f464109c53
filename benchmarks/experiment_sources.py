"""3D proposals and the map with each source of 2D proposals, and with files that other programs would have made."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from cuboid import open_recording
from cuboid.method.proposals import Proposals, make_source
from cuboid.runs.pipeline.options import TrackOptions
from scenes import Case, cases
from scoring import mean, run_and_score
from tables import cell, dump, show

SOURCES = ("depth", "edgeboxes", "selective-search")
HEADER = (
    "source",
    "3D boxes a frame",
    "precision .25",
    "recall .25",
    "F1 .25",
    "precision .5",
    "recall .5",
    "F1 .5",
    "map F1 .5",
    "HOTA",
    "ms proposals",
    "ms a frame",
)
# Boxes or masks of a frame in a file: MCG writes thousands of boxes, CPMC some hundred masks.
MCG_BOXES, CPMC_MASKS = 1000, 150


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    found: dict[str, list[dict[str, Any]]] = {}
    chosen = cases(args.kinds, args.seeds, args.work, args.data)
    for case in chosen:
        for name, source in _sources(case, args).items():
            output = args.work / "runs" / "sources" / name.split()[0] / case.name
            row = run_and_score(case, output, TrackOptions(every=args.every, limit=args.limit, proposals=source))
            row["ms_proposals"] = row["ms_stages"]["proposals"]
            found.setdefault(name, []).append(row)
    if args.json:
        dump(found)
        return
    names = ("boxes_frame", *(f"frame_{key}_{iou}" for iou in (25, 50) for key in ("precision", "recall", "f1")))
    lines = [
        [
            name,
            cell(mean(rows, names[0]), 2),
            *(mean(rows, key) for key in (*names[1:], "f1_50", "hota")),
            *(cell(mean(rows, key), 1) for key in ("ms_proposals", "ms_frame")),
        ]
        for name, rows in found.items()
    ]
    show(f"Sources of 2D proposals, over {', '.join(case.name for case in chosen)}", HEADER, lines)


def _sources(case: Case, args: argparse.Namespace) -> dict[str, str]:
    sources = {name: name for name in SOURCES}
    if args.data is not None:
        sources["bing"] = f"bing:{args.data / 'bing-model'}"
    folder = args.work / "proposals" / case.name
    files = {
        "MCG file (boxes of edgeboxes)": ("edgeboxes", write_mcg),
        "CPMC file (masks of depth)": ("depth", write_cpmc),
    }
    for name, (source, write) in files.items():
        _write_files(case, folder / name.split()[0], source, write, args.every, args.limit)
        sources[name] = f"precomputed:{folder / name.split()[0]}"
    return sources


def _write_files(case: Case, folder: Path, name: str, write: Any, every: int, limit: int | None) -> None:
    """Write a .mat file a frame, as another program would have."""
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    recording, source = open_recording(case.recording), make_source(name)
    for index in range(0, len(recording), every)[:limit]:
        frame = recording.read(index)
        size = frame.depth_m.shape
        write(folder / f"{index:06d}.mat", source(frame, recording.intrinsics), size)


def write_mcg(path: Path, proposals: Proposals, size: tuple[int, int]) -> None:
    """Write boxes as MCG does: up, left, down, right from 1, inclusive."""
    x0, y0, x1, y1 = proposals.boxes_xyxy[:MCG_BOXES].T.astype(np.float64)
    boxes = np.stack([y0 + 1, x0 + 1, y1, x1], axis=1)
    scipy.io.savemat(path, {"bboxes": boxes, "bboxes_scores": proposals.scores[:MCG_BOXES, None].astype(np.float64)})


def write_cpmc(path: Path, proposals: Proposals, size: tuple[int, int]) -> None:
    """Write masks as CPMC does: one after the other along the third axis."""
    full = proposals.full_masks()
    assert full is not None
    count = min(len(proposals.scores), CPMC_MASKS)
    masks = np.zeros((*size, count), bool)
    for k in range(count):
        x0, y0, x1, y1 = proposals.boxes_xyxy[k]
        masks[y0:y1, x0:x1, k] = full[k] > 0
    scores = proposals.scores[:count, None].astype(np.float64)
    scipy.io.savemat(path, {"masks": masks, "scores": scores}, do_compression=True)
