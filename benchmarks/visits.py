"""Scenes that last: labels and changes over visits, a place known again, and none taken for another.

python benchmarks/visits.py NAME --work DIR [--data DATA] [--kinds KIND ...] [--seeds N ...] [--json]

NAME is one of

  changes  pairs of made visits (`cuboid synth --visits 2`), poses given: labels kept, what was moved, gone, new
  away     the same pairs as one run: things are moved and taken away while the camera looks elsewhere
  halves   scene 01 of RGB-D Scenes v2 (--data) in two recordings, frames 0-449 and 450-887, poses estimated
  places   recordings shown to the scenes of other rooms, made ones and those of --data: none may be recognised

DIR keeps the made recordings and the scenes.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cuboid import CuboidError, Tracker, open_recording
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry.se3 import transform
from cuboid.inputs.readers import Recording
from cuboid.inputs.recordings.converting import convert_recording
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.timed_poses import read_poses
from cuboid.lab.evaluation.trajectory import associate, evaluate_trajectory, rigid_fit
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.evaluation.visits import evaluate_visits, is_visits
from cuboid.lab.synthetic import make_visits, render_visits
from cuboid.results.files import PoseRow
from cuboid.runs.pipeline.options import ResultOptions, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.scene import Scene
from cuboid.runs.scene.database import open_to_read
from cuboid.runs.scene.localisation import ESTIMATED
from cuboid.runs.scene.running import IntoScene
from cuboid.runs.scene.saving import load_state
from scenes import SIZE, MadeScene, made, scene_01, source_digest
from tables import dump, show

KINDS, SEEDS = ("table", "clutter", "leave"), {"table": range(1, 7), "clutter": range(1, 4), "leave": range(1, 4)}
FRAMES = 120
# Time between two visits that are tracked as one run, seconds; an object is at a place within this distance, metres.
AWAY_S, NEAR_M = 20.0, 0.06
# Where scene 01 is cut.
HALF = 450
# Rooms of the tries: so many frames, every other one, make the scene; so many, spread over all, are shown to others.
ROOMS = [
    ("table", 11),
    ("table", 12),
    ("tables", 11),
    ("tables", 12),
    ("clutter", 11),
    ("leave", 11),
    ("room", 11),
    ("room", 12),
]
REAL = ("rgbd-scenes-v2/imgs/scene_01", "rgbd_dataset_freiburg1_xyz", "desk-realsense")
ROOM_SIZE, ROOM_FRAMES = (320, 240), 60
SHOWN = 12
# Numbers of frames that come later than any of the scene's.
LATER = 1_000_000


def changes(args: argparse.Namespace) -> None:
    """Judge pairs of made visits."""
    rows = []
    for kind in args.kinds or KINDS:
        for seed in args.seeds or SEEDS.get(kind, (1, 2, 3)):
            visits = _visits(kind, seed, args)
            scene = _fresh(args.work / "scenes" / f"{visits.name}.cuboid")
            for visit in sorted(visits.glob("visit-*")):
                track_recording(open_recording(visit), None, into=IntoScene(scene, same_world=True))
            rows.append({"place": f"{kind} {seed}", **evaluate_visits(scene, visits).to_dict()})
            print(rows[-1], file=sys.stderr, flush=True)
    if args.json:
        dump(rows)
        return
    names = ("unmoved", "kept", "moved", "recognised", "changes", "told", "right", "hidden_called_gone")
    total = {name: sum(row[name] for row in rows) for name in names}
    table = [[row["place"], *(row[name] for name in names)] for row in rows]
    show("Pairs of visits", ("place", *names), [*table, ["all", *total.values()]])
    fractions = {"kept": "unmoved", "recognised": "moved", "right": "changes"}
    print(
        {
            **{a: round(total[a] / max(total[b], 1), 3) for a, b in fractions.items()},
            "precision": round(total["right"] / max(total["told"], 1), 3),
        }
    )


def away(args: argparse.Namespace) -> None:
    """Judge pairs of made visits that are tracked as one recording."""
    rows = []
    for kind in args.kinds or KINDS:
        for seed in args.seeds or SEEDS.get(kind, (1, 2, 3)):
            visits = _visits(kind, seed, args)
            rows.append({"place": f"{kind} {seed}", **_while_away(visits)})
            print(rows[-1], file=sys.stderr, flush=True)
    if args.json:
        dump(rows)
        return
    names = ("unmoved", "kept", "moved", "recognised", "left", "gone", "seconds")
    middle = [row["seconds"] for row in rows if row["seconds"] is not None]
    total = [*(sum(row[name] for row in rows) for name in names[:-1]), float(np.median(middle))]
    table = [[row["place"], *(row[name] for name in names)] for row in rows]
    show("Changes while the camera looks away", ("place", *names), [*table, ["all", *total]])


def _while_away(visits: Path) -> dict[str, Any]:
    """Track both visits as one recording; return what became of the labels of the first one.

    `left` counts the labels in places that the second visit shows to be empty, `gone` those that are no longer there
    at the end, `seconds` is the median time until then.
    """
    before, after = (open_recording(visits / f"visit-{k}") for k in (1, 2))
    tracker = Tracker(before.intrinsics)
    for index in range(len(before)):
        tracker.update(before.read(index))
    truth = json.loads((visits / "visits.json").read_text(encoding="utf-8"))["visits"][1]["changes"]
    first = {one["id"]: _label_at(tracker, one["from"]) for one in truth if one.get("from") and one["judged"]}
    begin_s = before.read(len(before) - 1).timestamp_s + AWAY_S
    there_s: dict[int, float] = {}
    for index in range(len(after)):
        frame = after.read(index)
        time_s = begin_s + frame.timestamp_s
        tracker.update(replace(frame, index=len(before) + index, timestamp_s=time_s))
        empty = {k: _label_at(tracker, one["from"]) for one in truth if (k := one["id"]) in first}
        there_s |= {k: time_s - begin_s for k, label in empty.items() if label == first[k]}
    kinds = {one["id"]: one for one in truth if first.get(one["id"])}
    last = {k: _label_at(tracker, one["to"]) for k, one in kinds.items() if one.get("to")}
    unmoved = [k for k, one in kinds.items() if one["change"] == "unchanged"]
    moved = [k for k, one in kinds.items() if one["change"] == "moved" and one["metres"] > NEAR_M and last[k]]
    left = [k for k, one in kinds.items() if one["change"] != "unchanged" and one["empty_frames"] > len(after) // 2]
    end_s = max(there_s.values(), default=0.0)
    gone = [k for k in left if there_s.get(k, 0.0) < end_s]
    return {
        "unmoved": len(unmoved),
        "kept": sum(last[k] == first[k] for k in unmoved),
        "moved": len(moved),
        "recognised": sum(last[k] == first[k] for k in moved),
        "left": len(left),
        "gone": len(gone),
        "seconds": float(np.median([there_s.get(k, 0.0) for k in gone])) if gone else None,
    }


def _label_at(tracker: Tracker, center_m: Sequence[float]) -> int | None:
    """Return the label of the object that is nearest to a place, None if there is none near it."""
    off = {o.label: float(np.linalg.norm(o.box.center - center_m)) for o in tracker.objects}
    label = min(off, key=off.__getitem__, default=None)
    return label if label is not None and off[label] < NEAR_M else None


def _visits(kind: str, seed: int, args: argparse.Namespace) -> Path:
    """Return a folder of made visits, rendering it unless it is there."""
    width, height = args.size
    name = f"{kind}-{seed}-{args.frames}f-{width}x{height}"
    folder: Path = args.work / "visits" / source_digest("lab/synthetic") / name
    if not is_visits(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(folder, ignore_errors=True)
        render_visits(make_visits(kind, seed, 2, frames=args.frames), folder, size=args.size)
    return folder


def _fresh(scene: Path) -> Path:
    scene.parent.mkdir(parents=True, exist_ok=True)
    for left in scene.parent.glob(f"{scene.name}*"):  # the log of a run that was broken off, too
        left.unlink()
    return scene


def halves(args: argparse.Namespace) -> None:
    """Let scene 01 go into a scene as two recordings, the second begun lost."""
    case = scene_01(args.data)
    whole = open_recording(case.recording)
    scene = _fresh(args.work / "scenes" / "halves.cuboid")
    outputs = []
    for number, frames in enumerate((range(HALF), range(HALF, len(whole))), 1):
        part = args.work / "recordings" / f"scene-01-half-{number}"
        if not part.is_dir():
            part.parent.mkdir(parents=True, exist_ok=True)
            convert_recording(whole, part, "plain", frames)
        outputs.append(args.work / "results" / part.name)
        track_recording(
            open_recording(part),
            outputs[-1],
            TrackOptions(poses="estimated"),
            results=ResultOptions(force=True, page=False),
            into=IntoScene(scene),
        )
    found = _judge_halves(scene, outputs, case.truth)
    if args.json:
        dump(found)
    else:
        show("Scene 01 in two halves", list(found), [list(found.values())])


def _judge_halves(scene: Path, outputs: Sequence[Path], truth: Path) -> dict[str, Any]:
    """Return how the second half lies in the world of the first, and what became of the five objects."""
    estimates = [read_poses(output) for output in outputs]
    folders = [output.parents[1] / "recordings" / output.name for output in outputs]
    true = [read_poses(folder) for folder in folders]
    pairs = [associate(a.times_s, b.times_s, 0.01) for a, b in zip(estimates, true, strict=True)]
    xyz = [
        (a.T_world_camera[i, :3, 3], b.T_world_camera[j, :3, 3])
        for a, b, (i, j) in zip(estimates, true, pairs, strict=True)
    ]
    T_true_world = rigid_fit(xyz[0][1], xyz[0][0])
    away = np.linalg.norm(transform(T_true_world, xyz[1][0]) - xyz[1][1], axis=1)
    labels = [_labels_of(output, truth, folder) for output, folder in zip(outputs, folders, strict=True)]
    with Scene.open(scene) as opened:
        first_found = min(opened.poses(2), default=None)
    return {
        "recognised in frame": first_found,
        "without a pose": len(true[1]) - len(estimates[1]),
        "ATE cm in the first one's world": 100 * float(np.sqrt((away**2).mean())),
        "by itself": evaluate_trajectory(estimates[1], true[1]).ate_cm.rmse,
        "of the first half": evaluate_trajectory(estimates[0], true[0]).ate_cm.rmse,
        "labels kept": sum(labels[1][0].get(k) == label for k, label in labels[0][0].items()),
        "objects": len(labels[0][0]),
        "new on the table": len(labels[1][1] - labels[0][1] - set(labels[0][0].values())),
    }


def _labels_of(output: Path, truth: Path, recording: Path) -> tuple[dict[int, int], set[int]]:
    """Return the label of each true object by its id, and those on the table that are none."""
    trajectory = recording.with_suffix(".txt")
    poses = read_poses(recording)
    rows = zip(poses.times_s.tolist(), poses.T_world_camera, strict=True)
    trajectory.write_text("".join(PoseRow(t, T).line() + "\n" for t, T in rows), encoding="utf-8")
    found = evaluate(output, replace(read_truth(truth), visibility=None), trajectory=trajectory)
    return {item.id: item.box.label for item in found.objects if item.box is not None}, set(found.map.wrong_labels)


def places(args: argparse.Namespace) -> None:
    """Show recordings to the scenes of other rooms."""
    rooms = {f"{kind} {seed}": made(MadeScene(kind, seed, size=ROOM_SIZE), args.work).recording for kind, seed in ROOMS}
    if args.data is not None:
        rooms |= {name: args.data / name for name in REAL}
    scenes = {}
    for name, path in rooms.items():
        scenes[name] = _fresh(args.work / "scenes" / f"place-{len(scenes)}.cuboid")
        track_recording(
            open_recording(path),
            None,
            TrackOptions(poses="estimated", every=2, limit=ROOM_FRAMES),
            into=IntoScene(scenes[name]),
        )
    tries, found = [], []
    for known, scene in scenes.items():
        for shown, path in rooms.items():
            if shown != known:
                recognised = _shown(scene, open_recording(path))
                tries.append((known, shown))
                found += [(known, shown, recognised)] if recognised else []
                print(f"{len(tries)}: {shown} shown to {known}: {recognised} recognised", file=sys.stderr, flush=True)
    if args.json:
        dump({"tries": len(tries), "false": [list(one) for one in found]})
    else:
        print(f"{len(tries)} tries between different rooms, {SHOWN} frames each: {len(found)} recognised {found or ''}")


def _shown(scene: Path, recording: Recording) -> int:
    """Return how many frames of a recording, spread over it, are taken for a place of a scene, each begun lost."""
    with closing(open_to_read(scene)) as connection:
        tracker, poses = load_state(connection, recording.intrinsics)
    count = 0
    for index in np.linspace(0, len(recording) - 1, SHOWN).astype(int).tolist():
        poses.begin(ESTIMATED, first=False)
        with suppress(FrameError):
            poses.locate(replace(recording.read(index), index=LATER + index, T_world_camera=None), tracker.up)
            count += poses.recognised
    return count


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=("changes", "away", "halves", "places"))
    parser.add_argument("--work", type=Path, required=True, metavar="DIR")
    parser.add_argument("--data", type=Path, default=None, metavar="DATA")
    parser.add_argument("--kinds", nargs="+", default=None)
    parser.add_argument("--seeds", nargs="+", type=int, default=None, metavar="N")
    parser.add_argument("--frames", type=int, default=FRAMES, metavar="N", help="of a made visit")
    parser.add_argument("--size", nargs=2, type=int, default=SIZE, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)
    try:
        {"changes": changes, "away": away, "halves": halves, "places": places}[args.name](args)
    except CuboidError as error:
        print(f"visits: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
