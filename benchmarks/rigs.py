"""Several cameras, one map: made rigs against their best single camera, and a real recording played as two cameras.

python benchmarks/rigs.py --work DIR [--scene RGBD_SCENES_V2/imgs/scene_01] [--seeds N] [--workers N]

For each made rig the table has: objects of the truth that two cameras see, the fraction of them with one label in the
pictures of all cameras, HOTA of the rig, of the best single camera, and of the rig in the frames of this camera, each
against the truth of these frames, the processor time of a round of frames (one of each camera) as a multiple of a
single camera's frame, by turns, and the errors of the poses from `cuboid calibrate --rig`. The scene is played as two
cameras, its even and its odd frames, with given poses.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cuboid import Tracker
from cuboid.ground.core.errors import CuboidError
from cuboid.ground.geometry.overlap import iou_matrix, pack
from cuboid.ground.geometry.se3 import angle, inverse, quat_wxyz_from_rotation
from cuboid.inputs.recordings.opening import open_recording
from cuboid.inputs.recordings.rig import RigRecording
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.result import BoxRows, read_result
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.synthetic import make_rig, render_recording
from cuboid.results.files import Results
from cuboid.runs.pipeline.options import ResultOptions
from cuboid.runs.pipeline.rig_calibrating import calibrate_rig
from cuboid.runs.pipeline.run import track_recording

# Kind of scene, number of cameras, whether they move, frames of each.
RIGS = (("table", 3, False, 20), ("clutter", 4, False, 20), ("bin", 2, False, 20), ("room", 2, True, 230))
# A camera sees an object if it shows this fraction of it in so many frames.
SEEN_FRACTION, SEEN_FRAMES = 0.3, 3
SAME_IOU = 0.25


@dataclass(frozen=True, slots=True)
class Row:
    """The figures of one rig."""

    name: str
    shared: int
    one_label: float
    hota: float
    best_single: float
    in_its_frames: float
    rounds: float
    error_mm: float
    error_degrees: float

    def text(self) -> str:
        """Return the row as text."""
        return (
            f"{self.name:22} {self.shared:6} {self.one_label:9.3f} {self.hota:6.3f} {self.best_single:6.3f} "
            f"{self.in_its_frames:6.3f} {self.rounds:7.2f} {self.error_mm:8.1f} {self.error_degrees:8.2f}"
        )


HEAD = f"{'rig':22} shared one label   HOTA single within  rounds error mm  degrees"


def made_rigs(work: Path, seeds: int, workers: int) -> Iterator[Path]:
    """Render the made rigs that are not there yet; yield their folders."""
    for kind, cameras, moving, frames in RIGS:
        for seed in range(1, seeds + 1):
            path = work / f"{kind}-{seed}-{'moving-' if moving else ''}{cameras}"
            if not path.is_dir():
                scene = make_rig(kind, seed, cameras, moving=moving, frames=frames)
                render_recording(scene, path, workers=workers)
            yield path


def tracked(recording: Path, output: Path) -> Results:
    """Track a recording; return its results."""
    options = ResultOptions(force=True, page=False, furniture=False)
    track_recording(open_recording(recording), output, results=options)
    return Results(output)


def hota_of(results: Results, truth: Path) -> float:
    """Return HOTA against a truth."""
    identity = evaluate(results.folder, truth).identity
    assert identity is not None
    return identity.hota.hota


def row_of(path: Path, work: Path) -> Row:
    """Return the figures of a rig."""
    rig = open_recording(path)
    assert isinstance(rig, RigRecording)
    found = tracked(path, work / f"{path.name}-found")
    names = [part.camera.name for part in rig.parts]
    singles = [tracked(path / name, work / f"{path.name}-{name}") for name in names]
    alone = {name: hota_of(one, path / name / "truth.json") for name, one in zip(names, singles, strict=True)}
    best = max(alone, key=lambda name: alone[name])
    shared, one_label = labels_of(rig, found, path)
    error_mm, error_degrees = (np.nan, np.nan) if rig.kind == "moving" else pose_errors(rig)
    return Row(
        path.name,
        shared,
        one_label,
        hota_of(found, path / "truth.json"),
        alone[best],
        hota_in_frames_of(found, best, path / best / "truth.json"),
        time_of_round(rig),
        error_mm,
        error_degrees,
    )


def hota_in_frames_of(results: Results, name: str, truth: Path) -> float:
    """Return HOTA of a rig in the frames of one camera, against the truth of this camera alone."""
    whole, of_camera = read_result(results.folder), np.array([row.camera == name for row in results.tracks])
    tracks, own = whole.tracks, results.report.rig_frames[1]
    rows = BoxRows(own[tracks.frame[of_camera]], tracks.label[of_camera], tracks.boxes[of_camera])
    used = np.array(list(results.of_camera(name).poses))
    identity = evaluate(replace(whole, tracks=rows, proposals=None, frames=used, events=()), truth).identity
    assert identity is not None
    return identity.hota.hota


def time_of_round(rig: RigRecording) -> float:
    """Return the processor time of a round of frames, one of each camera, as a multiple of a frame of one camera.

    The rig and each camera alone have a tracker; they take the frames by turns. The first quarter, in which the maps
    begin, is left out.
    """
    names = [part.camera.name for part in rig.parts]
    trackers = {name: Tracker(rig.intrinsics, poses="given") for name in ("", *names)}
    times: dict[str, list[float]] = defaultdict(list)
    for index in range(len(rig)):
        frame = rig.read(index)
        turns = ("", frame.camera_name)
        for name in turns if index // len(names) % 2 else turns[::-1]:
            begun_s = time.thread_time()
            trackers[name].update(frame)
            if index >= len(rig) // 4:
                times[name].append(time.thread_time() - begun_s)
    return len(names) * float(np.mean(times[""]) / np.mean([np.mean(times[name]) for name in names]))


def labels_of(rig: RigRecording, found: Results, path: Path) -> tuple[int, float]:
    """Return the number of objects that two cameras see, and the fraction with one label in all their pictures."""
    truth = json.loads((path / "truth.json").read_text(encoding="utf-8"))
    cameras, judged = len(rig.parts), {item["id"] for item in truth["objects"] if item["judged"]}
    seen: dict[int, set[int]] = {}
    for number, runs in truth["visibility"]["objects"].items():
        values = np.concatenate([np.full(int(length), value) for value, length in runs])
        counts = [int((values[k::cameras] >= SEEN_FRACTION).sum()) for k in range(cameras)]
        seen[int(number)] = {k for k, count in enumerate(counts) if count >= SEEN_FRAMES}
    names = [part.camera.name for part in rig.parts]
    shared = [item for item in read_truth(path).objects if item.id in judged and len(seen[item.id]) > 1]
    rows = list(found.tracks)
    overlap = iou_matrix(pack([item.box for item in shared]), pack([row.box for row in rows]))
    labels: dict[int, dict[str, Counter[int]]] = defaultdict(lambda: defaultdict(Counter))
    for k, item in enumerate(shared):
        for j in np.flatnonzero(overlap[k] >= SAME_IOU).tolist():
            labels[item.id][rows[j].camera][rows[j].label] += 1
    one = 0
    for item in shared:
        of = {camera: counts.most_common(1)[0][0] for camera, counts in labels[item.id].items()}
        one += all(names[k] in of for k in seen[item.id]) and len(set(of.values())) == 1
    return len(shared), one / max(len(shared), 1)


def pose_errors(rig: RigRecording) -> tuple[float, float]:
    """Return the largest errors of the poses that the scene gives, millimetres and degrees; NaN if it gives none."""
    names = [part.camera.name for part in rig.parts]
    try:
        fit, _ = calibrate_rig([part.recording for part in rig.parts], names)
    except CuboidError as error:
        print(error)
        return np.nan, np.nan
    true = [rig.rig.T_rig_camera[name] for name in names]
    errors = [inverse(inverse(true[0]) @ T) @ fit.T_rig_camera[k] for k, T in enumerate(true)]
    return max(1000 * float(np.linalg.norm(E[:3, 3])) for E in errors), max(np.degrees(angle(E)) for E in errors)


def as_two_cameras(scene: Path, work: Path) -> Path:
    """Write a recording with poses as two recordings, of its even and its odd frames, with a rig.json."""
    recording, path = open_recording(scene), work / f"{scene.name}-two"
    for k, name in enumerate(("even", "odd")):
        folder = path / name
        for part in ("color", "depth"):
            (folder / part).mkdir(parents=True, exist_ok=True)
        poses, times = [], []
        for j, index in enumerate(range(k, len(recording), 2)):
            for part, form in (("color", ".jpg"), ("depth", ".png")):
                link = folder / part / f"{j:06d}{form}"
                link.unlink(missing_ok=True)
                link.symlink_to((scene / f"{index:05d}-{part}{form}").resolve())
            T = recording.pose(index)
            assert T is not None
            w, x, y, z = quat_wxyz_from_rotation(T[:3, :3])
            poses.append(f"{j} " + " ".join(f"{value:.9f}" for value in (*T[:3, 3], x, y, z, w)))
            times.append(f"{j} {recording.timestamp_s(index):.6f}")
        (folder / "poses.txt").write_text("\n".join(poses) + "\n", encoding="utf-8")
        (folder / "timestamps.txt").write_text("\n".join(times) + "\n", encoding="utf-8")
        pinhole = {key: getattr(recording.intrinsics, key) for key in ("fx", "fy", "cx", "cy", "width", "height")}
        camera = {**pinhole, "depth_units_per_metre": recording.depth_units_per_metre}
        (folder / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    cameras = [{"name": name, "recording": name} for name in ("even", "odd")]
    rig = {"format": "cuboid-rig", "version": 1, "kind": "moving", "cameras": cameras}
    (path / "rig.json").write_text(json.dumps(rig), encoding="utf-8")
    return path


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    print(HEAD)
    for path in made_rigs(args.work, args.seeds, args.workers):
        print(row_of(path, args.work).text(), flush=True)
    if args.scene is not None:
        whole = tracked(args.scene, args.work / "whole")
        two = tracked(as_two_cameras(args.scene, args.work), args.work / "two")
        overlap = iou_matrix(pack([item.box for item in whole.objects]), pack([item.box for item in two.objects]))
        print(f"{args.scene.name}: {len(whole.objects)} objects as one camera, {len(two.objects)} as two;")
        print(f"IoU of each with the nearest one: {', '.join(f'{value:.2f}' for value in overlap.max(1))}")


if __name__ == "__main__":
    main()
