"""Stills as recordings: each is watched for a while by a camera that hardly moves, and judged at the last frame."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

# Number of frames that watch a still.
FRAMES = 20
# Movement of a camera held still by hand: standard deviation in each direction, metres.
SHAKE_M = 0.001
# Visible fraction that stands for an object that need not be found (low, small, or cut by the border): below the 0.3
# of keyframes, so that a sighting of it counts neither way.
NOT_WANTED = 0.1


@dataclass(frozen=True, slots=True)
class StillSet:
    """A set of stills with rectangles of the masks of their objects.

    Attributes
    ----------
    name : str
        Name of its folder.
    table : str
        File that lists the stills.
    color, depth : str
        Files of a still, with its name in braces.
    """

    name: str
    table: str
    color: str
    depth: str


STILL_SETS = (
    StillSet("hots", "objects.json", "{}.color.jpg", "{}.depth.png"),
    StillSet("osd_learn", "stills.json", "{}/color/000000.png", "{}/depth/000000.png"),
)


def still_parts(stills: StillSet, root: Path, work: Path) -> Iterator[tuple[str, Path, Path]]:
    """Make a recording of each still, with links to its images, and yield its name, folder and keyframes."""
    table = json.loads((root / stills.name / stills.table).read_text(encoding="utf-8"))
    for still in table["images"]:
        folder = work / "stills" / stills.name / still["name"]
        truth = folder / "keyframes.json"
        if not truth.is_file():
            source = (root / stills.name).resolve()
            _link(source / stills.color.format(still["name"]), folder / "color")
            _link(source / stills.depth.format(still["name"]), folder / "depth")
            camera = dict(zip(("fx", "fy", "cx", "cy"), still.get("K", table["K"]), strict=True))
            camera |= {name: still[name] for name in ("width", "height")}
            camera["depth_units_per_metre"] = table["depth_units_per_metre"]
            (folder / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
            (folder / "poses.txt").write_text(_poses(), encoding="utf-8")
            truth.write_text(json.dumps(keyframes_of(still)), encoding="utf-8")
        yield f"{stills.name}-{still['name']}", folder, truth


def keyframes_of(still: dict[str, Any]) -> dict[str, Any]:
    """Return the truth of a still as keyframes: its rectangles in the last frame."""
    boxes = [
        {"id": item["id"], "rect": item["rect"], "visible": 1.0 if item["reportable"] else NOT_WANTED}
        for item in still["objects"]
    ]
    return {
        "format": "cuboid-keyframes",
        "version": 1,
        "name": still["name"],
        "objects": [{"id": item["id"], "name": item["name"]} for item in still["objects"]],
        "frames": [{"frame": FRAMES - 1, "boxes": boxes}],
    }


def _link(image: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(FRAMES):
        link = folder / f"{index:06d}{image.suffix}"
        link.unlink(missing_ok=True)
        link.symlink_to(image)


def _poses() -> str:
    places = np.random.default_rng(0).normal(0.0, SHAKE_M, (FRAMES, 3))
    return "".join(f"{index} {x:.6f} {y:.6f} {z:.6f} 0 0 0 1\n" for index, (x, y, z) in enumerate(places))
