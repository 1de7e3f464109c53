"""Measure meshes of objects against the true surfaces of made recordings.

python benchmarks/shapes.py measure WORK [--kind table] [--seeds 1 2 3] [--poses given]     (this environment)
python benchmarks/peer_open3d_shapes.py WORK                                        (that of requirements-peers.txt)

`measure` renders each scene (`cuboid synth`) and tracks it where WORK does not have it, makes the mesh of each object,
and, where `peer_open3d_shapes.py` has written its meshes into WORK, judges them too. An object is found where its box
and the true one have an IoU of `MIN_IOU`. Per object, of points spread evenly over the mesh the distance to the true
surface (accuracy), and of the points of the true surface that the camera saw those with the mesh within `COMPLETE_M`
(completeness). Distances are to points of the true surface, `DENSITY` to a square metre: 0.3 mm apart.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

import cuboid
from cuboid.ground.geometry.overlap import iou_matrix, pack
from cuboid.lab.synthetic import make_scene
from cuboid.lab.synthetic.mesh import Mesh, sample_surface
from cuboid.results.files import read_map

MIN_IOU = 0.25
DENSITY, ON_MESH = 1e7, 20_000
COMPLETE_M = 0.005


def ready(work: Path, kind: str, seed: int, poses: str) -> tuple[Path, Path]:
    """Return a made recording and its results, made where they are not there."""
    recording, results = work / f"{kind}-{seed}", work / f"{kind}-{seed}-{poses}"
    call = [sys.executable, "-m", "cuboid"]
    if not recording.is_dir():
        subprocess.run([*call, "synth", "--kind", kind, "--seed", str(seed), "--output", str(recording)], check=True)
    if not results.is_dir():
        subprocess.run([*call, "track", str(recording), "--poses", poses, "--output", str(results)], check=True)
    return recording, results


def distances_m(vertices: np.ndarray, faces: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """Return the distance of points spread over a mesh to the points of a surface, metres."""
    points, _ = sample_surface(Mesh(vertices, faces), ON_MESH, np.random.default_rng(1))
    return cKDTree(surface).query(points)[0]


def completeness(vertices: np.ndarray, faces: np.ndarray, seen: np.ndarray) -> float:
    """Return the fraction of the seen points that the mesh is near to."""
    points, _ = sample_surface(Mesh(vertices, faces), 5 * ON_MESH, np.random.default_rng(2))
    return float((cKDTree(points).query(seen)[0] <= COMPLETE_M).mean())


def judge(work: Path, kind: str, seed: int, poses: str) -> list[dict[str, object]]:
    """Return a row for each found object of a scene and each maker of meshes."""
    recording, folder = ready(work, kind, seed, poses)
    scene, results = make_scene(kind, seed), cuboid.open_results(folder)
    cloud = read_map(recording / "true_cloud.ply")
    T_found_true = alignment(results, scene)
    true_boxes = [scene.box(body).moved(T_found_true) for body in scene.objects]
    overlap = iou_matrix(pack([item.box for item in results.objects]), pack(true_boxes))
    rows, rng = [], np.random.default_rng(3)
    for k, body in enumerate(scene.objects):
        item = results.objects[int(overlap[:, k].argmax())]
        seen = cloud.xyz[cloud.label == body.id].astype(np.float64)
        if overlap[:, k].max() < MIN_IOU or not len(seen):
            continue
        truth = body.mesh().moved(T_found_true @ scene.T_world_room)
        area = float(np.linalg.norm(truth.area_normals(), axis=1).sum() / 2)
        surface = sample_surface(truth, max(1000, int(area * DENSITY)), rng)[0]
        seen = seen @ T_found_true[:3, :3].T + T_found_true[:3, 3]
        for maker, (vertices, faces) in meshes(results, item, folder).items():
            if not len(faces):
                continue
            far = distances_m(vertices, faces, surface) * 1e3
            rows.append(
                {
                    "scene": f"{kind}-{seed}",
                    "object": body.model.name,
                    "label": item.label,
                    "maker": maker,
                    "median_mm": float(np.median(far)),
                    "p95_mm": float(np.percentile(far, 95)),
                    "complete": completeness(vertices, faces, seen),
                    "_all": far,
                }
            )
    return rows


def alignment(results: cuboid.Results, scene: object) -> np.ndarray:
    """Return the motion from the true world to that of the results: of estimated poses it is the first camera's."""
    first = next(iter(results.poses))
    if results.report.poses != "estimated":
        return np.eye(4)
    return results.poses[first].T_world_camera @ np.linalg.inv(scene.T_world_camera[first])


def meshes(results: cuboid.Results, item: cuboid.TrackedObject, folder: Path) -> dict[str, tuple]:
    """Return the meshes of an object by their makers."""
    own = results.mesh(item.label)
    found = {"cuboid": (own.vertices, own.faces)}
    peer = folder / "open3d" / f"{item.label}.ply"
    if peer.is_file():
        loaded = trimesh.load(peer, process=False)
        found["open3d"] = (np.asarray(loaded.vertices), np.asarray(loaded.faces))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--kind", default="table")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--poses", default="given", choices=("given", "estimated"))
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rows = [row for seed in args.seeds for row in judge(args.work, args.kind, seed, args.poses)]
    for row in rows:
        print(
            f"{row['scene']:10} {row['object']:12} #{row['label']:<3} {row['maker']:8} "
            f"median {row['median_mm']:5.2f} mm  95 % {row['p95_mm']:6.2f} mm  complete {row['complete']:.2f}"
        )
    for maker in sorted({str(row["maker"]) for row in rows}):
        own = [row for row in rows if row["maker"] == maker]
        far = np.concatenate([row["_all"] for row in own])
        print(
            f"{maker}: {len(own)} objects, median {np.median(far):.2f} mm, 95 % {np.percentile(far, 95):.2f} mm, "
            f"complete {np.mean([row['complete'] for row in own]):.2f}"
        )
    if args.json:
        kept = [{key: value for key, value in row.items() if key != "_all"} for row in rows]
        args.json.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
