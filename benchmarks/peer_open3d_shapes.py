"""Meshes of objects by Open3D's TSDF (`VoxelBlockGrid`): run it in an environment of its own, see `shapes.py`.

python benchmarks/peer_open3d_shapes.py RECORDING RESULTS [--voxel-mm 4] [--truncation VOXELS]

All frames of RECORDING (plain) are integrated with the poses in RESULTS, up to 3 m. The mesh is cut by the box of each
object, grown by 1 cm aside and above and 5 mm above its support, as Cuboid's own; pieces of less than a fiftieth go.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import open3d as o3d

FARTHEST_M, MARGIN_M, SUPPORT_M, MIN_PIECE = 3.0, 0.01, 0.005, 0.02


def fused(recording: Path, results: Path, voxel_m: float, truncation_voxels: float) -> o3d.geometry.TriangleMesh:
    """Return the surface of the whole recording."""
    camera = json.loads((recording / "camera.json").read_text())
    pinhole = o3d.core.Tensor(
        [[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]], o3d.core.float64
    )
    volume = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight", "color"),
        (o3d.core.float32, o3d.core.float32, o3d.core.float32),
        ((1), (1), (3)),
        voxel_size=voxel_m,
        block_resolution=16,
        block_count=50_000,
        device=o3d.core.Device("CPU:0"),
    )
    skipped = {one["frame"] for one in json.loads((results / "run.json").read_text())["frames"]["skipped"]}
    lines = (results / "trajectory.txt").read_text().splitlines()
    frames = [k for k in range(len(lines) + len(skipped)) if k not in skipped]
    units = float(camera["depth_units_per_metre"])
    for frame, line in zip(frames, lines, strict=True):
        color = o3d.t.io.read_image(str(recording / f"color/{frame:06d}.jpg"))
        depth = o3d.t.io.read_image(str(recording / f"depth/{frame:06d}.png"))
        x, y, z, *q = (float(word) for word in line.split()[1:])
        T = np.eye(4)
        T[:3, :3] = o3d.geometry.get_rotation_matrix_from_quaternion([q[3], *q[:3]])
        T[:3, 3] = x, y, z
        camera_world = o3d.core.Tensor(np.linalg.inv(T))
        blocks = volume.compute_unique_block_coordinates(
            depth, pinhole, camera_world, units, FARTHEST_M, truncation_voxels
        )
        volume.integrate(blocks, depth, color, pinhole, pinhole, camera_world, units, FARTHEST_M, truncation_voxels)
    return volume.extract_triangle_mesh().to_legacy()


def cut(mesh: o3d.geometry.TriangleMesh, item: dict, planes: list[dict]) -> o3d.geometry.TriangleMesh:
    """Return the part of the surface that belongs to an object."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    rotation, size = np.array(item["rotation"]), np.array(item["size"])
    away = np.abs((vertices - item["center"]) @ rotation) - size / 2
    kept = (away <= MARGIN_M).all(1)
    if item["plane"] is not None:
        plane = planes[item["plane"]]
        kept &= vertices @ plane["normal"] + plane["offset"] > SUPPORT_M
    rows = np.cumsum(kept) - 1
    part = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices[kept]), o3d.utility.Vector3iVector(rows[faces[kept[faces].all(1)]])
    )
    piece, sizes, _ = part.cluster_connected_triangles()
    sizes = np.asarray(sizes)
    part.remove_triangles_by_mask(sizes[np.asarray(piece)] < MIN_PIECE * sizes.sum())
    part.remove_unreferenced_vertices()
    return part


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--voxel-mm", type=float, default=4.0)
    parser.add_argument("--truncation", type=float, default=3.0)
    args = parser.parse_args()
    found = json.loads((args.results / "objects.json").read_text())
    whole = fused(args.recording, args.results, args.voxel_mm / 1e3, args.truncation)
    (args.results / "open3d").mkdir(exist_ok=True)
    for item in found["objects"]:
        path = args.results / "open3d" / f"{item['label']}.ply"
        o3d.io.write_triangle_mesh(str(path), cut(whole, item, found["planes"]))


if __name__ == "__main__":
    main()
