"""The ground-truth files of a synthetic recording: `truth.json`, the true trajectory, the labelled cloud.

``docs/evaluation.md`` describes them; `truth.json` has the format of truth files of real recordings.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import MapPoints
from cuboid.ground.geometry import se3
from cuboid.ground.geometry.box import Box
from cuboid.lab.synthetic.mesh import shift
from cuboid.lab.synthetic.relations import true_relations, true_walls
from cuboid.lab.synthetic.scene import FRAMES_PER_S, Agent, Scene, SceneEvent, SceneObject
from cuboid.results.files.ply import write_map
from cuboid.results.files.text import DIRECTION, LENGTH, number, numbers, rounded, rounded_list

TRUTH, TRAJECTORY, CLOUD = "truth.json", "true_trajectory.txt", "true_cloud.ply"

# An object is judged if at least this fraction of it is visible in at least this many frames.
SHOWN_FRACTION, SHOWN_FRAMES = 0.3, 8
# The cloud is thinned to one point per cube of this size, metres.
CLOUD_CELL_M = 0.008


def write_truth(path: Path, scene: Scene, intrinsics: Intrinsics, fractions: Float64Array) -> None:
    """Write `truth.json`.

    Parameters
    ----------
    path : Path
    scene : Scene
    intrinsics : Intrinsics
        Intrinsics of the recording.
    fractions : (N, M) float64
        Visible fraction of each object in each frame, in the order of `scene.objects`.
    """
    truth = {
        "format": "cuboid-truth",
        "version": 1,
        "name": scene.name,
        "frames": scene.frames,
        "K": [rounded(value, LENGTH) for value in (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)],
        "note": "exact, from the geometry that the recording was rendered from",
        "planes": [_plane(scene, k) for k in range(len(scene.surfaces))],
        "walls": true_walls(scene),
        "objects": _objects(scene, fractions),
        "relations": true_relations(scene),
        "judged_region": None,
        "ignore": [{"name": body.model.name, **_box(scene.box(body))} for body in scene.furniture if body.doubtful],
        "visibility": {
            "frames": scene.frames,
            "note": "share of the camera-facing points that true depth shows within 2 cm; 0.05 steps, "
            "[value, run length]; 0 = not visible",
            "objects": {str(body.id): run_lengths(fractions[:, k]) for k, body in enumerate(scene.objects)},
        },
    }
    if scene.events or scene.agents:
        truth["events"] = [_event(scene, one) for one in scene.events]
        truth["agents"] = [_agent(scene, one) for one in scene.agents]
    path.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def run_lengths(values: npt.ArrayLike) -> list[list[float | int]]:
    """Return the run-length encoding of values (N,): [value, length] of each run."""
    runs: list[list[float | int]] = []
    for value in np.asarray(values, np.float64).tolist():
        if runs and runs[-1][0] == value:
            runs[-1][1] += 1
        else:
            runs.append([value, 1])
    return runs


def _plane(scene: Scene, surface: int) -> dict[str, Any]:
    normal, offset = scene.plane(surface)
    return {
        "name": scene.surfaces[surface].name,
        "normal": rounded_list(normal, DIRECTION),
        "offset": rounded(offset, LENGTH),
    }


def _box(box: Box) -> dict[str, Any]:
    return {
        "center": rounded_list(box.center, LENGTH),
        "size": rounded_list(box.size, LENGTH),
        "rotation": [rounded_list(row, DIRECTION) for row in box.rotation],
    }


def _moves(scene: Scene, path: Float64Array, T_model_box: Float64Array) -> list[list[float | int]]:
    """Return the pose changes of a box that moves with a model, [frame, x, y, z, qw, qx, qy, qz]."""
    rows: list[list[float | int]] = []
    for frame, T in enumerate(scene.T_world_room @ path @ T_model_box):
        if frame == 0 or (path[frame] != path[frame - 1]).any():
            turn = se3.quat_wxyz_from_rotation(T[:3, :3])
            rows.append([frame, *rounded_list(T[:3, 3], LENGTH), *rounded_list(turn, DIRECTION)])
    return rows


def _moved_object(scene: Scene, body: SceneObject) -> dict[str, Any]:
    if body.path is None:
        return {}
    T_world_model, box = scene.T_world_room @ body.T_room_model, scene.box(body)
    return {"moves": _moves(scene, body.path, se3.inverse(T_world_model) @ se3.assembled(box.rotation, box.center))}


def _agent(scene: Scene, body: Agent) -> dict[str, Any]:
    vertices = body.model.mesh().vertices
    low, high = vertices.min(0), vertices.max(0)
    path = np.repeat(body.T_room_model[None], scene.frames, 0) if body.path is None else body.path
    moves = _moves(scene, path, shift((low + high) / 2))
    return {"name": body.model.name, "size": rounded_list(high - low, LENGTH), "moves": moves}


def _event(scene: Scene, one: SceneEvent) -> dict[str, Any]:
    body = next(body for body in scene.objects if body.id == one.id)
    places = (one.T_room_from, one.T_room_to)
    old, new = (None if T is None else scene.box(replace(body, T_room_model=T)).center for T in places)
    return {
        "event": one.event,
        "id": one.id,
        "begin": one.begin,
        "end": one.end,
        "from": None if old is None else rounded_list(old, LENGTH),
        "to": None if new is None else rounded_list(new, LENGTH),
    }


def _objects(scene: Scene, fractions: Float64Array) -> list[dict[str, Any]]:
    needed = min(SHOWN_FRAMES, max(1, scene.frames // 4))
    rows = []
    for k, body in enumerate(scene.objects):
        shown = int((fractions[:, k] >= SHOWN_FRACTION).sum()) >= needed
        rows.append(
            {
                "id": body.id,
                "name": body.model.name,
                "judged": body.judged and shown,
                **_box(scene.box(body)),
                **({"round": True} if scene.is_round(body) else {}),
                "plane": body.surface,
                "touches": list(body.touches),
                "frames_present": int((fractions[:, k] > 0).sum()),
                **_moved_object(scene, body),
            }
        )
    return rows


def pose_lines(keys: Sequence[str], T_world_camera: Float64Array) -> str:
    """Return lines `key tx ty tz qx qy qz qw` of poses (N, 4, 4)."""
    lines = []
    for key, T in zip(keys, T_world_camera, strict=True):
        w, x, y, z = se3.quat_wxyz_from_rotation(T[:3, :3])
        lines.append(f"{key} {numbers(T[:3, 3], LENGTH, ' ')} {numbers((x, y, z, w), DIRECTION, ' ')}\n")
    return "".join(lines)


def write_trajectory(path: Path, T_world_camera: Float64Array) -> None:
    """Write the true poses (N, 4, 4) in the TUM format, `timestamp tx ty tz qx qy qz qw`."""
    times = [number(k / FRAMES_PER_S, LENGTH) for k in range(len(T_world_camera))]
    path.write_text(pose_lines(times, T_world_camera), encoding="utf-8")


class LabelledCloud:
    """The thinned surfaces that the camera saw; each point has the label of its object."""

    def __init__(self) -> None:
        self._parts: list[tuple[Float32Array, UInt8Array, npt.NDArray[np.int32]]] = []

    def add(self, xyz: Float32Array, rgb: UInt8Array, label: npt.NDArray[np.int32]) -> None:
        """Add points (n, 3) in the world with colors (n, 3) and labels (n,); 0 is no object."""
        self._parts.append((xyz, rgb, label))

    def write(self, path: Path) -> None:
        """Write the cloud in the format of `map.ply`; heat is 1 on objects and 0 elsewhere."""
        xyz, rgb, label = (np.concatenate(columns) for columns in zip(*self._parts, strict=True))
        cell = np.floor(xyz / CLOUD_CELL_M).astype(np.int64)
        first = np.sort(np.unique(cell, axis=0, return_index=True)[1])
        heat = (label[first] > 0).astype(np.float32)
        write_map(path, MapPoints(xyz=xyz[first], rgb=rgb[first], heat=heat, label=label[first]))
