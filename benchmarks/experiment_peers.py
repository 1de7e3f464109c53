"""Other ways to the same end, on the same frames, judged by the same program.

`Open3D pipeline` is `peer_open3d.py`, run by `--peers-python` (`requirements-peers.txt` says what that needs).
`AB3DMOT` is `ab3dmot.py`: the association of that tracker, fed with this tracker's own boxes of single frames
(`proposals.csv`), as published, and never forgetting. Times are medians a frame: Cuboid's with decoding and writing,
the Open3D pipeline's with decoding, AB3DMOT's of the association alone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ab3dmot import track
from cuboid import CuboidError, open_recording
from cuboid.ground.formats.folder import OBJECTS
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import unpack
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.lab.evaluation import read_result
from cuboid.results.files import read_objects
from cuboid.runs.pipeline.options import TrackOptions
from observations import as_result
from scenes import Case, cases
from scoring import mean, run_and_score, score, summed_counts, total
from tables import cell, dump, show

FOREVER = 10**9
UNITS_PER_M = 5000
NEEDS = {
    "Cuboid": "poses or none; no GPU, no ROS, no training",
    "AB3DMOT on Cuboid's boxes": "boxes of each frame, poses; no GPU, no ROS",
    "the same, never forgetting": "boxes of each frame, poses; no GPU, no ROS",
    "Open3D pipeline": "poses; no GPU, no ROS, no training",
}
HEADER = (
    "system",
    "recall .5",
    "precision .5",
    "mean IoU",
    "boxes",
    "objects",
    "fragments",
    "HOTA",
    "DetA",
    "AssA",
    "IDF1 .25",
    "switches",
    "re-id",
    "ms a frame",
    "needs",
)


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    found: dict[str, list[dict[str, Any]]] = {}
    chosen = cases(args.kinds, args.seeds, args.work, args.data)
    for case in chosen:
        output = args.work / "runs" / "peers" / case.name
        rows = {"Cuboid": run_and_score(case, output, TrackOptions(every=args.every, limit=args.limit))}
        rows["AB3DMOT on Cuboid's boxes"] = associate(case, output)
        rows["the same, never forgetting"] = associate(case, output, max_age=FOREVER)
        if args.peers_python is not None:
            rows["Open3D pipeline"] = open3d_pipeline(case, output, args)
        for name, row in rows.items():
            found.setdefault(name, []).append(row)
    if args.json:
        dump(found)
        return
    for title, group in (
        ("all", found),
        *((case.name, {name: [rows[k]] for name, rows in found.items()}) for k, case in enumerate(chosen)),
    ):
        scenes = ", ".join(case.name for case in chosen) if title == "all" else title
        show(f"Peers, over {scenes}", HEADER, [_line(name, rows) for name, rows in group.items()])


def _line(name: str, rows: list[dict[str, Any]]) -> list[Any]:
    back = summed_counts(rows, "same_label", "reappearances")
    return [
        name,
        *(mean(rows, key) for key in ("recall_50", "precision_50", "mean_iou")),
        *(total(rows, key) for key in ("proposals", "objects", "fragments")),
        *(mean(rows, key) for key in ("hota", "det_a", "ass_a", "idf1_25")),
        total(rows, "switches"),
        f"{cell(back)} of {total(rows, 'reappearances')}",
        cell(mean(rows, "ms_frame"), 2),
        NEEDS[name],
    ]


def associate(case: Case, output: Path, **options: Any) -> dict[str, Any]:
    """Return the figures of AB3DMOT's association of the boxes that lie in a result folder."""
    ours = read_result(output)
    assert ours.frames is not None
    assert ours.proposals is not None
    up = read_objects(output / OBJECTS).up
    by_frame: dict[int, list[Box]] = {int(frame): [] for frame in ours.frames}
    for frame, box in zip(ours.proposals.frame.tolist(), unpack(ours.proposals.boxes), strict=True):
        by_frame[frame].append(box)
    begun = time.process_time()
    labelled = list(track(list(by_frame.values()), np.array([0.0, 0.0, 1.0]) if up is None else up, **options))
    took_ms = (time.process_time() - begun) * 1e3
    rows = [(frame, *item) for frame, items in zip(by_frame, labelled, strict=True) for item in items]
    return score(case, as_result(by_frame, rows)) | {"ms_frame": took_ms / len(by_frame)}


def open3d_pipeline(case: Case, output: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of the pipeline made of Open3D."""
    folder = case.recording if (case.recording / "camera.json").exists() else _plain(case, args.work)
    table = output.parent / f"{case.name}-open3d.csv"
    call = [args.peers_python, str(Path(__file__).with_name("peer_open3d.py")), str(folder), str(table)]
    call += ["--every", str(args.every), *([] if args.limit is None else ["--limit", str(args.limit)])]
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=dict(os.environ))
    if done.returncode != 0:
        raise CuboidError(f"{' '.join(call)}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}")
    ours = read_result(output)
    return score(case, replace(read_result(table), frames=ours.frames)) | json.loads(done.stdout)


def _plain(case: Case, work: Path) -> Path:
    """Return a recording as a plain one, depth alone."""
    folder = work / "plain" / case.name
    if (folder / "poses.txt").exists():
        return folder
    (folder / "depth").mkdir(parents=True, exist_ok=True)
    recording = open_recording(case.recording)
    camera = {name: getattr(recording.intrinsics, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    (folder / "camera.json").write_text(json.dumps(camera | {"depth_units_per_metre": UNITS_PER_M}))
    lines = []
    for index in range(len(recording)):
        frame = recording.read(index)
        units = np.rint(np.nan_to_num(frame.depth_m) * UNITS_PER_M).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{index:06d}.png"), units)
        T = frame.T_world_camera
        assert T is not None
        w, x, y, z = quat_wxyz_from_rotation(T[:3, :3])
        lines.append(" ".join(map(repr, (index, *T[:3, 3].tolist(), *map(float, (x, y, z, w))))))
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    return folder
