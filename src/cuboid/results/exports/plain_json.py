"""JSON for programs that know nothing of boxes: a collection of features with footprints, sizes in centimetres.

The layout is that of GeoJSON (a ``FeatureCollection``), but coordinates are centimetres in the world of the results,
not degrees. A feature is an object or a piece of furniture (its footprint: the face of its box that it stands on), or a
supporting plane (its outline); ``properties.kind`` says which. Rings are closed, counter-clockwise seen from above.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.palette import hex_of
from cuboid.ground.core.records import columns_of, plain_fields
from cuboid.ground.core.results import SUPPORT, SupportPlane, TrackedObject
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.results.files import Results
from cuboid.results.files.objects import write_json
from cuboid.results.files.text import CENTIMETRE, DIRECTION, LENGTH, rounded, rounded_list

# Corners of a box's lower face, in the order of `Box.corners`, counter-clockwise seen from above.
FOOTPRINT = (0, 1, 3, 2)
# Optional fields of an object that are unchanged; `kind` has another meaning here, and lengths are in centimetres.
CHANGED = ("kind", "size_sigma_m", "center_sigma_m")
OPTIONAL = tuple(one for one in columns_of(TrackedObject) if one.optional and one.name not in CHANGED)


def write(run: Results, path: Path) -> list[str]:
    """Write the file."""
    found, first_s = run.found, {frame: pose.timestamp_s for frame, pose in run.poses.items()}
    document = {
        "type": "FeatureCollection",
        "units": "cm",
        "up": None if found.up is None else rounded_list(found.up, DIRECTION),
        "features": [
            *(_object(item, first_s) for item in (*found.objects, *found.furniture)),
            *(_plane(number, plane) for number, plane in enumerate(found.planes)),
        ],
    }
    write_json(path, document)
    return []


def kind_of(item: TrackedObject) -> str:
    """Return "support" for furniture, else "object"."""
    return SUPPORT if item.kind == SUPPORT else "object"


def _object(item: TrackedObject, time_s: dict[int, float]) -> dict[str, Any]:
    length_cm, width_cm, height_cm = (rounded(100.0 * side, CENTIMETRE) for side in item.box.size)
    times = [time_s.get(frame) for frame in (item.first_frame, item.last_frame)]
    first_s, last_s = (None if time is None else rounded(time, LENGTH) for time in times)
    properties = {
        "kind": kind_of(item),
        "label": item.label,
        "color": hex_of(item.label),
        "length_cm": length_cm,
        "width_cm": width_cm,
        "height_cm": height_cm,
        "center_cm": rounded_list(100.0 * item.box.center, CENTIMETRE),
        "rotation_quat_wxyz": rounded_list(quat_wxyz_from_rotation(item.box.rotation), DIRECTION),
        "stands_on_plane": item.plane,
        "score": rounded(item.score, LENGTH),
        "first_frame": item.first_frame,
        "last_frame": item.last_frame,
        "first_seen_s": first_s,
        "last_seen_s": last_s,
        "frames_seen": item.frames_seen,
        **plain_fields(item, OPTIONAL),
        "mean_color_rgb": rounded_list(item.mean_color, 1),
        "merged_labels": list(item.merged_labels),
    }
    return _feature(f"object-{item.label}", item.box.corners()[list(FOOTPRINT)], properties)


def _plane(number: int, plane: SupportPlane) -> dict[str, Any]:
    properties = {
        "kind": "plane",
        "number": number,
        "normal": rounded_list(plane.normal, DIRECTION),
        "offset_cm": rounded(100.0 * plane.offset, CENTIMETRE),
    }
    return _feature(f"plane-{number}", _counter_clockwise(plane.extent, plane.normal), properties)


def _counter_clockwise(outline: Float64Array, normal: Float64Array) -> Float64Array:
    """Return the outline (N, 3) of a plane in the order that is counter-clockwise seen from its upper side."""
    if len(outline) < 3:
        return outline
    around = np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0)
    return outline if around @ normal >= 0 else outline[::-1]


def _feature(name: str, ring: Float64Array, properties: dict[str, Any]) -> dict[str, Any]:
    closed = [rounded_list(100.0 * point, CENTIMETRE) for point in (*ring, *ring[:1])]
    return {
        "type": "Feature",
        "id": name,
        "geometry": {"type": "Polygon", "coordinates": [closed]},
        "properties": properties,
    }
