"""Makes RGB-D pictures with instance masks of many kinds of places, on which scores of image regions are fitted.

    pip install mujoco==4.0.0
    pip install --no-deps -r benchmarks/pictures/requirements.txt
    python benchmarks/pictures/picture_scenes.py --scenes 0-99 --views 5 --out DIR

A scene becomes DIR/scene-NNNNN with color-V.jpg, depth-V.png (16 bit, millimetres, 0: no reading), mask-V.png (16 bit,
0: structure, 1 and up: things, 65535: ignore) and camera.json, 640 x 480 pixels. The number of a scene decides its
recipe, things, light, sensor and views. Existing folders are skipped, so a stopped run continues. Two seconds a scene.

Ignored are hands, chairs, papers, cables, pictures and sockets at walls, and bins with heaps. Doors and drawers of
cupboards, windows and heaters are structure.

Six meshes and the textures of surfaces are those of robosuite (MIT); all other things are made by the code here. Larger
collections of scanned things are left out, since their terms limit the use of fitted weights: the meshes of HOPE, which
are in LIBERO, are under CC BY-NC-SA 4.0.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")  # before the first import of mujoco: it draws without a screen

import cv2
import numpy as np
import numpy.typing as npt
from looks import Look
from meshes import Floats, Rng, pick
from recipes import RECIPES
from sensors import draw_sensor, measure
from stage import HEIGHT, WIDTH, Stage

from cuboid.ground.core.frame import Intrinsics
from scene import IGNORE, Focus, Scene

# Kinds of views: ranges of elevation over the target, degrees, and of the distance from it, metres.
VIEWS = {
    "hand": ((20, 60), (0.6, 1.6)), "overhead": ((78, 90), (0.5, 1.5)), "steep": ((55, 80), (0.45, 1.3)),
    "grazing": ((2, 14), (0.45, 1.5)), "close": ((12, 70), (0.35, 0.6)), "far": ((8, 35), (1.6, 3.0)),
    "front": ((-12, 25), (0.7, 1.7)), "close_front": ((-10, 25), (0.4, 0.8)),
}  # fmt: skip
FOCAL_PX = (430.0, 505.0, 525.0, 570.0, 615.0)
# Attempts to find a view, the least number of things in it in each third of them, and the least fraction with depth.
TRIES, WANTED, MIN_READ = 24, (4, 2, 1), 0.5
SETTLE_S = 1.2


def draw_pose(scene: Scene, focus: Focus, rng: Rng) -> Floats | None:
    """Draw T_world_camera of a view of a focus; None where it lies outside the room."""
    kinds = list(focus.modes)
    weights = np.array([focus.modes[k] for k in kinds])
    (low, high), distances = VIEWS[str(rng.choice(kinds, p=weights / weights.sum()))]
    elevation = np.radians(rng.uniform(low, high))
    azimuth = np.radians(focus.azimuth_deg[0] + focus.azimuth_deg[1] * rng.uniform(-1, 1))
    target = focus.point + np.array([*rng.uniform(-1, 1, 2) * focus.radius_m, rng.uniform(0, 0.08)])
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    eye = target + back * rng.uniform(*distances)
    if not ((eye > scene.bounds[0]) & (eye < scene.bounds[1])).all():
        return None
    up = [0, 0, 1.0] if elevation < np.radians(75) else [np.cos(azimuth + 0.1), np.sin(azimuth + 0.1), 0]
    right = np.cross(-back, up)
    right /= np.linalg.norm(right)
    roll = np.radians(rng.uniform(-20, 20) if rng.random() < 0.3 else rng.normal(0, 4))
    down = np.cross(-back, right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1] = right * np.cos(roll) + down * np.sin(roll), down * np.cos(roll) - right * np.sin(roll)
    pose[:3, 2], pose[:3, 3] = -back, eye
    return pose


def is_useful(labels: npt.NDArray[np.uint16], wanted: int) -> bool:
    """Whether a view shows so many things of 300 px or more, and no more than half of it is ignored."""
    counts = np.bincount(labels[labels != IGNORE], minlength=2)[1:]
    return bool((counts > 300).sum() >= wanted and (labels == IGNORE).mean() < 0.5)


def write_view(stage: Stage, look: Look, sensor: str, folder: Path, number: int, rng: Rng) -> bool:
    """Write one view; False where no useful one was found."""
    f = stage.focal_px
    intrinsics = Intrinsics(f, f, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5, WIDTH, HEIGHT)
    for attempt in range(TRIES):
        focus = pick(rng, stage.scene.focuses)
        pose = draw_pose(stage.scene, focus, rng)
        if pose is None:
            continue
        stage.look(pose)
        labels, finish = stage.labels()
        if not is_useful(labels, WANTED[3 * attempt // TRIES]):
            continue
        exact = stage.exact(finish)
        if (exact.depth_m < 0.22).mean() > 0.08:  # the camera is inside of something or behind it
            continue
        depth = np.round(measure(exact, sensor, intrinsics, rng) * 1000).clip(0, 65535).astype(np.uint16)
        if (depth > 0).mean() < MIN_READ:
            continue
        color = look.picture(exact.color, rng)
        cv2.imwrite(str(folder / f"color-{number}.jpg"), color[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
        cv2.imwrite(str(folder / f"depth-{number}.png"), depth)
        cv2.imwrite(str(folder / f"mask-{number}.png"), labels)
        return True
    return False


def write_scene(number: int, views: int, out: Path) -> str:
    """Build, settle and draw a scene; its folder appears when it is complete. Returns a line for the log."""
    began = time.perf_counter()
    rng = np.random.default_rng([number, 7])
    recipe = RECIPES[number % len(RECIPES)]
    scene = Scene(rng)
    recipe(scene)
    stage = Stage(scene, float(rng.choice(FOCAL_PX)))
    stage.settle(SETTLE_S * (1.6 if recipe.__name__ == "heap" else 1))
    name = draw_sensor(rng)
    look = Look.draw(rng)
    built = time.perf_counter() - began
    folder = out / f".scene-{number:05d}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    done = sum(write_view(stage, look, name, folder, n, np.random.default_rng([number, n, 8])) for n in range(views))
    stage.close()
    f = stage.focal_px
    camera = {
        "fx": f,
        "fy": f,
        "cx": WIDTH / 2 - 0.5,
        "cy": HEIGHT / 2 - 0.5,
        "width": WIDTH,
        "height": HEIGHT,
        "recipe": recipe.__name__,
        "sensor": name,
    }
    (folder / "camera.json").write_text(json.dumps(camera))
    folder.rename(out / f"scene-{number:05d}")
    spent = time.perf_counter() - began
    return f"scene {number} {recipe.__name__}: {done} views, built in {built:.1f} s, {spent:.1f} s in all"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", required=True, help="first and last number, such as 0-99")
    parser.add_argument("--views", type=int, default=5, help="pictures per scene (default 5)")
    parser.add_argument("--out", type=Path, required=True, help="folder for the pictures")
    args = parser.parse_args()
    first, last = (int(x) for x in args.scenes.split("-"))
    for number in range(first, last + 1):
        if (args.out / f"scene-{number:05d}").exists():
            continue
        try:
            print(write_scene(number, args.views, args.out), flush=True)
        except (RuntimeError, ValueError) as problem:
            print(f"scene {number}: left out: {problem}", flush=True)


if __name__ == "__main__":
    main()
