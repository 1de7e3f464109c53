"""Truth files: which objects there are, where they are judged, and which of them each frame shows.

``docs/evaluation.md`` describes the format, "cuboid-truth" version 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.errors import InputError
from cuboid.frame import Float64Array
from cuboid.geometry.box import Box
from cuboid.outputs.objects import read_json

FORMAT, VERSION = "cuboid-truth", 1
NAME = "truth.json"

# A rotation written with four digits deviates from one by no more than this.
ROTATION_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class TruthObject:
    """An object that is there.

    Attributes
    ----------
    id : int
        Positive, its own.
    name : str
        For people.
    judged : bool
        False where finding it counts neither way.
    box : Box
        In the world of the truth.
    round : bool
        Whether it looks alike from all sides: its box may be turned about the third axis.
    """

    id: int
    name: str
    judged: bool
    box: Box
    round: bool = False


@dataclass(frozen=True, slots=True)
class JudgedRegion:
    """The part of the world that the truth speaks about: a prism over a polygon on a plane.

    Attributes
    ----------
    normal : (3,) float64
        Unit normal of the plane n.p + offset = 0.
    offset : float
        Metres.
    polygon : (N, 3) float64
        Outline on the plane, in order, metres.
    height_m : (float, float)
        From and to, along the normal.
    """

    normal: Float64Array
    offset: float
    polygon: Float64Array
    height_m: tuple[float, float]

    def contains(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Tell for each point (N, 3) whether it lies inside, (N,)."""
        height = points @ self.normal + self.offset
        low, high = self.height_m
        across = np.linalg.svd(self.normal[None])[2][1:].T  # two directions along the plane
        corners, spots = self.polygon @ across, points @ across
        inside = np.zeros(len(points), bool)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            # Even-odd rule: each edge that a ray along +x crosses takes the point in or out.
            crossed = (y0 > spots[:, 1]) != (y1 > spots[:, 1])
            if crossed.any():
                inside ^= crossed & (spots[:, 0] < x0 + (x1 - x0) * (spots[:, 1] - y0) / (y1 - y0))
        return np.asarray(inside & (height >= low) & (height <= high))


@dataclass(frozen=True, slots=True)
class Truth:
    """What a truth file says.

    Attributes
    ----------
    path : Path
    name : str
    frames : int or None
        Of the recording; None where the file does not say.
    objects : tuple of TruthObject
        By id.
    region : JudgedRegion or None
        None: everything is judged.
    ignored : tuple of Box
        Places where finding something counts neither way.
    visibility : (frames, objects) float64 or None
        Visible share of each object in each frame, 0..1; None where the file does not say.
    """

    path: Path
    name: str
    frames: int | None
    objects: tuple[TruthObject, ...]
    region: JudgedRegion | None
    ignored: tuple[Box, ...]
    visibility: Float64Array | None


def read_truth(path: Path) -> Truth:
    """Read a truth file, or the one named `NAME` in a folder.

    Raises
    ------
    InputError
        The file is missing, is no truth file, or lacks a field; the message names file and field.
    """
    path = path / NAME if path.is_dir() else path
    document = read_json(path)
    if document.get("format") != FORMAT or document.get("version") != VERSION:
        raise InputError(
            f"{path}: expected format '{FORMAT}' version {VERSION}, "
            f"got '{document.get('format')}' version {document.get('version')}"
        )
    try:
        objects = tuple(sorted(map(_object, document["objects"]), key=lambda item: item.id))
        if len({item.id for item in objects}) < len(objects):
            raise ValueError("two objects have the same id")
        frames, visibility = _visibility(document, objects)
        return Truth(
            path=path,
            name=str(document.get("name", path.stem)),
            frames=frames,
            objects=objects,
            region=_region(document.get("judged_region")),
            ignored=tuple(map(_box, document.get("ignore") or ())),
            visibility=visibility,
        )
    except KeyError as error:
        raise InputError(f"{path}: field {error} is missing") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: a field is malformed: {error}") from error


def _object(item: dict[str, Any]) -> TruthObject:
    number = int(item["id"])
    name, judged, is_round = str(item.get("name", number)), bool(item.get("judged", True)), bool(item.get("round"))
    return TruthObject(number, name, judged, _box(item), is_round)


def _box(item: dict[str, Any]) -> Box:
    center, size, rotation = (np.array(item[name], np.float64) for name in ("center", "size", "rotation"))
    box = Box(center, size, rotation)
    if not (np.isfinite(center).all() and np.isfinite(size).all() and (size > 0).all()):
        raise ValueError(f"a box needs a finite center and a size above 0, got {item['center']}, {item['size']}")
    if not np.abs(rotation @ rotation.T - np.eye(3)).max() <= ROTATION_TOLERANCE:
        raise ValueError(f"expected a rotation matrix, got {item['rotation']}")
    return box


def _region(item: dict[str, Any] | None) -> JudgedRegion | None:
    if item is None:
        return None
    polygon = np.array(item["polygon"], np.float64)
    normal = np.array(item["normal"], np.float64)
    if polygon.ndim != 2 or polygon.shape[1] != 3 or len(polygon) < 3 or normal.shape != (3,):
        raise ValueError(f"judged_region needs a normal (3,) and a polygon (3 or more, 3), got {polygon.shape}")
    length = float(np.linalg.norm(normal))
    if not length > 0:
        raise ValueError("judged_region has a normal without direction")
    height = float(item["hmin"]), float(item["hmax"])
    return JudgedRegion(normal / length, float(item["offset"]) / length, polygon, height)


def _visibility(document: dict[str, Any], objects: tuple[TruthObject, ...]) -> tuple[int | None, Float64Array | None]:
    """Return the number of frames, and the visible share (frames, objects) from its run lengths."""
    frames = document.get("frames")
    item = document.get("visibility")
    if item is None:
        return None if frames is None else int(frames), None
    count = int(item["frames"])
    if frames is not None and int(frames) != count:
        raise ValueError(f"visibility speaks of {count} frames, the file of {frames}")
    shares = np.zeros((count, len(objects)))
    for k, thing in enumerate(objects):
        runs = item["objects"].get(str(thing.id))
        if runs is None:
            if thing.judged:
                raise ValueError(f"visibility of object {thing.id} is missing")
            continue
        values, lengths = np.array(runs, np.float64).reshape(-1, 2).T
        if lengths.sum() != count or not ((values >= 0) & (values <= 1)).all():
            raise ValueError(
                f"visibility of object {thing.id}: expected shares 0..1 over {count} frames, "
                f"got {int(lengths.sum())} frames of {values.min():g} to {values.max():g}"
            )
        shares[:, k] = np.repeat(values, lengths.astype(np.int64))
    return count, shares
