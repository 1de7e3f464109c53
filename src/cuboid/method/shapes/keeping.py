"""Views of a run's objects, stored in `views.zip`: meshes need them after the frames are gone.

::

    views.zip
      views.json            [{"label", "frame", "visible", "box": [15 numbers], "at": [x0, y0]}, ...], in order
      000000.png            depth of the view, 16 bits, in units of 0.2 mm
      000000.jpg            color of the view

A view is kept if the camera sees the object from a new side. If an object has more than `MAX_FUSED_VIEWS` views, the
minimum angle between them is increased.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import Sighting, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import iou_matrix, pack, unpack
from cuboid.method.shapes.views import MAX_FUSED_VIEWS, MIN_VISIBLE, Candidate, ObjectView, chosen, view_of

# Two views of an object differ if the angle between their directions is at least APART_RAD, radians, or if the camera's
# distance from the object has become less than NEARER times the earlier one.
APART_RAD, NEARER = 0.1, 0.7
# Factor by which the minimum angle grows when an object has more than `MAX_FUSED_VIEWS` views.
WIDER = 1.3
# Maximum size of all views of a run, bytes: about a hundred objects of common size.
MAX_VIEW_BYTES = 256 << 20
# Units of depth per metre (16 bits then reach 13 m); quality of the JPEG.
DEPTH_UNITS_PER_M, VIEW_JPEG_QUALITY = 5000, 90
INDEX = "views.json"
# Date of every file in the archive: the same run must give the same bytes.
DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class KeptView:
    """A stored view: the fields of `Candidate`, its encoded images, and the camera of its frame if that is of a rig."""

    frame: int
    box: Box
    visible: float
    T_world_camera: Float64Array
    at: tuple[int, int]
    png: bytes
    jpeg: bytes
    rig_camera: Intrinsics | None = None

    @property
    def size(self) -> int:
        """Size in bytes."""
        return len(self.png) + len(self.jpeg)

    def opened(self, camera: Intrinsics, T_world_camera: Float64Array) -> ObjectView:
        """Return the view with decoded images; `camera` is that of the whole frame without a rig."""
        camera = self.rig_camera or camera
        raw = cv2.imdecode(np.frombuffer(self.png, np.uint8), cv2.IMREAD_UNCHANGED)
        color = cv2.imdecode(np.frombuffer(self.jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
        if raw is None or color is None or raw.shape != color.shape[:2] or raw.dtype != np.uint16:
            raise InputError(f"the view of frame {self.frame} is damaged")
        (height, width), (x0, y0) = raw.shape, self.at
        part = replace(camera, cx=camera.cx - x0, cy=camera.cy - y0, width=width, height=height)
        depth_m = raw.astype(np.float32) / np.float32(DEPTH_UNITS_PER_M)
        return ObjectView(depth_m, np.asarray(color, np.uint8), part, T_world_camera)


@dataclass(slots=True, eq=False)
class ViewKeeper:
    """Keeps views of the objects of a run.

    Attributes
    ----------
    camera : Intrinsics
        Camera of the frames.
    """

    camera: Intrinsics
    _views: dict[int, list[KeptView]] = field(default_factory=dict)
    _apart_rad: dict[int, float] = field(default_factory=dict)
    _bytes: int = 0
    _left_out: dict[int, int] = field(default_factory=dict)

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line if views were left out because the views of the run reached their maximum size."""
        count, objects = sum(self._left_out.values()), len(self._left_out)
        if not count:
            return ()
        return (
            f"{count} views of {objects} object{'s' if objects > 1 else ''} were left out: together, views are limited "
            f"to {MAX_VIEW_BYTES >> 20} MB; meshes of these objects may have holes without the recording",
        )

    def add(self, frame: Frame, T_world_camera: Float64Array, sightings: Sequence[Sighting]) -> None:
        """Keep the views in a frame that show a new side of their objects."""
        for seen in sightings:
            if seen.visible >= MIN_VISIBLE:
                self._add(frame, T_world_camera, seen)

    def _add(self, frame: Frame, T_world_camera: Float64Array, seen: Sighting) -> None:
        views = self._views.setdefault(seen.label, [])
        if views and not iou_matrix(pack([views[-1].box]), pack([seen.box]))[0, 0] > 0:
            self._drop(seen.label, [])  # the object was moved
            views = self._views[seen.label]
        apart_rad = self._apart_rad.setdefault(seen.label, APART_RAD)
        if not _is_new(T_world_camera, views, seen.box, apart_rad):
            return
        camera = frame.intrinsics_or(self.camera)
        view = view_of(frame, camera, T_world_camera, seen.box)
        if view is None:
            return
        at = round(camera.cx - view.camera.cx), round(camera.cy - view.camera.cy)
        png, jpeg = _encoded(view)
        if self._bytes + len(png) + len(jpeg) > MAX_VIEW_BYTES:
            self._left_out[seen.label] = self._left_out.get(seen.label, 0) + 1
            return
        of_rig = None if frame.camera is None else camera
        views.append(KeptView(frame.index, seen.box, seen.visible, T_world_camera, at, png, jpeg, of_rig))
        self._bytes += views[-1].size
        while len(views) > MAX_FUSED_VIEWS:
            self._apart_rad[seen.label] *= WIDER
            views = self._drop(seen.label, _spread(views, seen.box, self._apart_rad[seen.label]))

    def _drop(self, label: int, kept: list[KeptView]) -> list[KeptView]:
        """Replace the views of an object by some of them; return these."""
        self._bytes -= sum(view.size for view in self._views[label]) - sum(view.size for view in kept)
        self._views[label] = kept
        return kept

    def views(
        self, item: TrackedObject, T_world_camera: Mapping[int, Float64Array], most: int | None = None
    ) -> list[ObjectView]:
        """Return at most `most` views of an object, with the current poses of their frames."""
        kept = [view for label in (item.label, *item.merged_labels) for view in self._views.get(label, ())]
        return opened(kept, self.camera, item.box, T_world_camera, most)

    def content(self) -> bytes:
        """Return the contents of the file `views.zip`."""
        rows: list[dict[str, Any]] = []
        target = io.BytesIO()
        with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
            for label, views in sorted(self._views.items()):
                for view in views:
                    name = f"{len(rows):06d}"
                    archive.writestr(zipfile.ZipInfo(f"{name}.png", DATE), view.png)
                    archive.writestr(zipfile.ZipInfo(f"{name}.jpg", DATE), view.jpeg)
                    box = [float(value) for value in pack([view.box])[0]]
                    row = {"label": label, "frame": view.frame, "visible": view.visible, "box": box, "at": view.at}
                    of_rig = view.rig_camera
                    rows.append(row if of_rig is None else row | {"camera": asdict(of_rig)})
            archive.writestr(zipfile.ZipInfo(INDEX, DATE), json.dumps(rows, indent=0))
        return target.getvalue()


def read_views(
    path: Path,
    item: TrackedObject,
    camera: Intrinsics,
    T_world_camera: Mapping[int, Float64Array],
    most: int | None = None,
) -> list[ObjectView]:
    """Read the views of an object from a file `views.zip`; see `ViewKeeper.views`.

    Raises
    ------
    InputError
        The file is damaged.
    """
    labels, kept = {item.label, *item.merged_labels}, []
    try:
        with zipfile.ZipFile(path) as archive:
            rows: list[dict[str, Any]] = json.loads(archive.read(INDEX))
            for number, row in enumerate(rows):
                if row["label"] not in labels:
                    continue
                box = unpack(np.array([row["box"]], np.float64).reshape(1, 15))[0]
                png, jpeg = (archive.read(f"{number:06d}.{kind}") for kind in ("png", "jpg"))
                x0, y0 = (int(value) for value in row["at"])
                of_rig = Intrinsics(**row["camera"]) if "camera" in row else None
                values = int(row["frame"]), box, float(row["visible"]), np.eye(4), (x0, y0), png, jpeg, of_rig
                kept.append(KeptView(*values))
        return opened(kept, camera, item.box, T_world_camera, most)
    except (OSError, zipfile.BadZipFile, KeyError, TypeError, ValueError, cv2.error, InputError) as error:
        raise InputError(f"{path}: expected views of objects, as 'cuboid track --shapes' keeps them: {error}") from None


def opened(
    kept: Sequence[KeptView],
    camera: Intrinsics,
    box: Box,
    T_world_camera: Mapping[int, Float64Array],
    most: int | None = None,
) -> list[ObjectView]:
    """Select views as `chosen` does, decode them, and return them with the poses of their frames."""
    view_of = {view.frame: view for view in sorted(kept, key=lambda view: view.frame) if view.frame in T_world_camera}
    candidates = [Candidate(view.frame, view.box, view.visible, T_world_camera[k]) for k, view in view_of.items()]
    return [view_of[one.frame].opened(camera, one.T_world_camera) for one in chosen(candidates, box, most)]


def _is_new(T_world_camera: Float64Array, views: Sequence[KeptView], box: Box, apart_rad: float) -> bool:
    """Return whether a camera sees an object from another side than all views do, or from much nearer."""
    if not views:
        return True
    towards = np.array([T_world_camera[:3, 3], *(view.T_world_camera[:3, 3] for view in views)]) - box.center
    distance = np.linalg.norm(towards, axis=1)
    cosine = towards[1:] @ towards[0] / np.maximum(distance[1:] * distance[0], 1e-12)
    alike = (cosine > np.cos(apart_rad)) & (distance[0] > NEARER * distance[1:])
    return not alike.any()


def _spread(views: Sequence[KeptView], box: Box, apart_rad: float) -> list[KeptView]:
    """Return the views that differ from all earlier ones."""
    kept: list[KeptView] = []
    for view in views:
        if _is_new(view.T_world_camera, kept, box, apart_rad):
            kept.append(view)
    return kept


def _encoded(view: ObjectView) -> tuple[bytes, bytes]:
    units = np.rint(np.minimum(view.depth_m * np.float32(DEPTH_UNITS_PER_M), 65535)).astype(np.uint16)
    png = cv2.imencode(".png", units, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    bgr = np.ascontiguousarray(view.color[..., ::-1])
    return png, cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, VIEW_JPEG_QUALITY])[1].tobytes()
