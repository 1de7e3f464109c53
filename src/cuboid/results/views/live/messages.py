"""Messages to the page: a moment as JSON with its picture, and a map as packed numbers."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import MapPoints, TrackedObject, names_of
from cuboid.results.files.objects import surface_to_json
from cuboid.results.files.text import rounded, rounded_list
from cuboid.results.views.dimensions import add_dimensions
from cuboid.results.views.drawing import draw_frame, hidden_objects
from cuboid.results.views.live.watch import CameraView, Moment
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.report.page import SHARED, assembled
from cuboid.results.views.report.points import STEP_M, spacing, stepped, thinned
from cuboid.results.views.report.summary import (
    TURN_DIGITS,
    event_document,
    inferno,
    object_document,
    packed,
)
from cuboid.results.views.tags import TAG_PX, Rect
from cuboid.results.views.text import ink

SCRIPTS = (*SHARED, "follow.js", "live.js")

# 1.8 MB per map: a forwarded port in a local network transfers it in a fraction of a second.
MAX_MAP_POINTS = 150_000

# Width of the picture, which is shown beside the scene and in the pyramid of the camera: 30 kB.
PICTURE_WIDTH_PX = 480
PICTURE_QUALITY = 80

# Minimum number of points for measuring the spacing of the map.
MIN_POINTS = 1000


def page_of(title: str, intrinsics: Intrinsics, moment: Moment | None, first_pose: Float64Array | None) -> str:
    """Return the page as HTML, with the data so far.

    Parameters
    ----------
    title : str
    intrinsics : Intrinsics
        Of the recording's color image.
    moment : Moment or None
        None before the first frame.
    first_pose : (4, 4) float64 or None
        T_world_camera of the first frame: the initial point of view of the scene.
    """
    poses = np.zeros((0, 12)) if first_pose is None else first_pose[:3].reshape(1, 12)
    document = {
        "title": title,
        "camera": asdict(intrinsics),
        "inferno": packed(inferno()),
        "frames": packed(np.arange(len(poses), dtype="<i4")),
        "poses": packed(poses.astype("<f4")),
        "points": {"count": 0, "total": 0, "low": [0.0, 0.0, 0.0], "step_m": STEP_M, "spacing_m": 0.01},
        **(_scene(moment) if moment is not None else {"up": None, "objects": [], "events": [], "planes": []}),
    }
    return assembled("live.html", ["page.css", "live.css"], SCRIPTS, document, package="cuboid.results.views.live")


def moment_message(moment: Moment, intrinsics: Intrinsics, measured: int | None = None) -> bytes:
    """Return a moment as JSON.

    Parameters
    ----------
    moment : Moment
    intrinsics : Intrinsics
        Of the recording's color image; a camera of a rig has its own.
    measured : int, optional
        Label of the object whose dimensions the picture has.
    """
    document = {
        "number": moment.number,
        "frame": moment.frame,
        "used": moment.used,
        "seen": len(moment.seen),
        "milliseconds": rounded(moment.milliseconds, 1),
        "cameras": [_camera(view, moment.objects, intrinsics, measured) for view in moment.cameras],
        **_scene(moment),
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode("ascii")


def warm_up() -> None:
    """Load the palette and the font now; otherwise the first picture would be charged with 0.1 s of loading."""
    color_of(1)
    ink("#1", TAG_PX)


def end_message(complete: bool, warnings: Sequence[str] = ()) -> bytes:
    """Return the message that the run has ended, with its warnings."""
    return json.dumps({"ended": True, "complete": complete, "warnings": list(warnings)}).encode("ascii")


def map_message(number: int, points: MapPoints, spacing_m: float, max_points: int = MAX_MAP_POINTS) -> bytes:
    """Return a map in the binary format of the page.

    Four bytes with the length of a JSON text, the text (padded with spaces to a multiple of 4), then three arrays over
    the points: red, green, blue, heat (8 bit each); three steps from ``low`` (16 bit each); the label (16 bit).
    Little-endian.

    Parameters
    ----------
    number : int
        Number of the map.
    points : MapPoints
        N points in the world.
    spacing_m : float
        Distance between neighbouring points of the whole map.
    max_points : int
        Largest number of points sent.
    """
    kept = thinned(points.label, max_points)
    low, step_m, steps = stepped(points.xyz[kept])
    look = np.empty((len(kept), 4), np.uint8)
    look[:, :3] = points.rgb[kept]
    look[:, 3] = np.clip(points.heat[kept] * 255.0, 0.0, 255.0)
    header = {
        "number": number,
        "count": len(kept),
        "total": len(points.xyz),
        "low": rounded_list(low, TURN_DIGITS),
        "step_m": step_m,
        "spacing_m": spacing_m * float(np.sqrt(max(len(points.xyz), 1) / max(len(kept), 1))),
    }
    text = json.dumps(header, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    parts = (
        len(text).to_bytes(4, "little"),
        text,
        look.tobytes(),
        steps.astype("<u2").tobytes(),
        points.label[kept].astype("<u2"),
    )
    return b"".join(bytes(part) for part in parts)


def spacing_of(points: MapPoints) -> float | None:
    """Return the distance between neighbouring points of a map, metres; None if it has too few points."""
    return spacing(points.xyz) if len(points.xyz) >= MIN_POINTS else None


def _scene(moment: Moment) -> dict[str, Any]:
    """Return the data of a moment for the scene of the page."""
    seen = moment.seen
    return {
        "up": None if moment.up is None else rounded_list(moment.up, TURN_DIGITS),
        "objects": [{**object_document(item), "seen": item.label in seen} for item in moment.objects],
        "events": [event_document(event) for event in moment.events],
        "planes": [surface_to_json(plane) for plane in moment.planes],
    }


def _camera(
    view: CameraView, objects: Sequence[TrackedObject], intrinsics: Intrinsics, measured: int | None
) -> dict[str, Any]:
    """Return the data of one camera: its place, and its picture as JPEG in base64."""
    intrinsics = intrinsics if view.camera is None else view.camera.intrinsics
    return {
        "name": "" if view.camera is None else view.camera.name,
        "lens": asdict(intrinsics),
        "pose": rounded_list(view.T_world_camera[:3].ravel(), TURN_DIGITS),
        "path": packed(view.path.astype("<f4")),
        "picture": base64.b64encode(_picture(view, objects, intrinsics, measured)).decode("ascii"),
        "ended": view.ended,
    }


def _picture(view: CameraView, objects: Sequence[TrackedObject], intrinsics: Intrinsics, measured: int | None) -> bytes:
    """Return the reduced frame with its boxes, and with the dimensions of one object, as JPEG."""
    hidden = hidden_objects(view.sightings, objects)
    color, camera = _small(view.color, intrinsics)
    T, names, tags = view.T_world_camera, names_of(objects), list[Rect]()
    picture = draw_frame(color, T, camera, view.sightings, hidden, None, names=names, places=tags)
    add_dimensions(picture, [item.box for item in objects if item.label == measured], T, camera, "cm", tags)
    return encode_jpeg(picture, PICTURE_QUALITY)


def _small(color: UInt8Array, intrinsics: Intrinsics) -> tuple[UInt8Array, Intrinsics]:
    """Return a picture at most `PICTURE_WIDTH_PX` wide, and its pinhole."""
    height, width = color.shape[:2]
    if width <= PICTURE_WIDTH_PX:
        return color, intrinsics
    small = PICTURE_WIDTH_PX, max(1, round(height * PICTURE_WIDTH_PX / width))
    x, y = small[0] / width, small[1] / height
    K = intrinsics
    camera = Intrinsics(K.fx * x, K.fy * y, (K.cx + 0.5) * x - 0.5, (K.cy + 0.5) * y - 0.5, *small)
    # At half the size or less, each pixel is a mean. Above that, averaging costs more than all other steps.
    how = cv2.INTER_AREA if 2 * small[0] <= width else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(color, small, interpolation=how), np.uint8), camera
