"""A frame with its objects drawn into it: boxes that look solid, legible tags, and a status strip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import Sighting, TrackedObject, tag_of
from cuboid.ground.geometry.box import Box
from cuboid.results.views.projection import TOP, Wireframe, may_be_in_view, wireframes
from cuboid.results.views.tags import Rect, SteadyNames, place_tags, put_tag, tag_px, unit_of
from cuboid.results.views.text import Color, put_text

# Sizes in pixels for an image 640 pixels wide; `unit_of` scales them for larger images.
FRONT_PX = 2
THIN_PX = 1
HALO_PX = 2
DASH_PX = 7.0
GAP_PX = 5.0
STRIP_PX = 24
STRIP_TEXT_PX = 14

# Opacity of the drawing on visible surfaces: a light tint, stronger on the top than on the sides, as if lit from
# above. Halos, hidden edges and hidden objects are translucent.
TOP_FRACTION = 0.30
SIDE_FRACTION = 0.12
BEHIND_FRACTION = 0.62
STRIP_FRACTION = 0.70

DARK = (14, 16, 20)
WHITE = (245, 246, 248)

# Fractional bits of the coordinates given to cv2: a sixteenth of a pixel.
SHIFT = 4


# Largest number of characters of a tag.
LONGEST_TAG = 28


class Labelled(Protocol):
    """An item with a label and a box: a sighting or an object of the map."""

    @property
    def label(self) -> int:
        """Its label."""

    @property
    def box(self) -> Box:
        """Its box in the world."""


class Scored(Labelled, Protocol):
    """An item with a label, a box and a score: a proposal."""

    @property
    def score(self) -> float:
        """Its score, 0..1."""


@dataclass(frozen=True, slots=True)
class Status:
    """The contents of the strip under the picture.

    Attributes
    ----------
    frame : int
        Of the recording.
    seen, known : int
        Objects in this frame and in the map.
    """

    frame: int
    seen: int
    known: int


@dataclass(frozen=True, slots=True)
class _Drawn:
    """One box that will be drawn into the picture."""

    color: Color
    texts: tuple[str, ...]  # possible texts of its tag, the longest first
    wire: Wireframe
    rect_xyxy: Float64Array
    dashed: bool


def draw_frame(
    color: UInt8Array,
    T_world_camera: Float64Array,
    intrinsics: Intrinsics,
    sightings: Iterable[Labelled],
    hidden: Iterable[Labelled],
    status: Status | None,
    tinted: bool = True,
    names: Mapping[int, str] | None = None,
    steady: SteadyNames | None = None,
    places: list[Rect] | None = None,
) -> UInt8Array:
    """Return a picture with the boxes of its objects.

    Edges behind a box are thin and dim, edges in front are thick. Each line has a dark halo, so that it is visible on
    any background. Objects of the map that the frame does not see are dashed. Nearer boxes are drawn over farther ones.

    Parameters
    ----------
    color : (H, W, 3) uint8
        RGB; not changed.
    T_world_camera : (4, 4) float64
    intrinsics : Intrinsics
        Of `color`.
    sightings : iterable of Sighting
        Objects seen in the frame.
    hidden : iterable of TrackedObject
        Objects of the map that the frame does not see; objects out of the view are not drawn.
    status : Status or None
        None omits the strip.
    tinted : bool
        Whether the sides of boxes are tinted in the color of the box; False if the colors of the picture encode values.
    names : mapping of int to str, optional
        Names of the objects, by label.
    steady : SteadyNames, optional
        State of the names in the video to which the picture belongs as its next frame.
    places : list of (left, top, right, bottom), optional
        Gets the places of the tags, pixels.

    Returns
    -------
    (H, W, 3) uint8
    """
    items = [(item, _texts(item.label, names or {}), True) for item in hidden]
    items += [(item, _texts(item.label, names or {}), False) for item in sightings]
    drawn = _in_view(items, T_world_camera, intrinsics)
    picture, tags = _draw(color, intrinsics, drawn, status, tinted, steady)
    if places is not None:
        places.extend(tags)
    return picture


def draw_boxes(
    color: UInt8Array, T_world_camera: Float64Array, intrinsics: Intrinsics, items: Iterable[Labelled]
) -> tuple[UInt8Array, list[Rect]]:
    """Return a picture with boxes without tints, and the places of their tags: left, top, right, bottom in pixels."""
    drawn = _in_view([(item, _texts(item.label, {}), False) for item in items], T_world_camera, intrinsics)
    return _draw(color, intrinsics, drawn, None, tinted=False)


def hidden_objects(sightings: Sequence[Sighting], objects: Sequence[TrackedObject]) -> list[TrackedObject]:
    """Return the objects of the map that a frame with these sightings does not see."""
    seen = {sighting.label for sighting in sightings}
    return [item for item in objects if item.label not in seen]


def _texts(label: int, names: Mapping[int, str]) -> tuple[str, ...]:
    """Return the possible texts of a tag, the longest first: with the name, with a shortened name, without a name."""
    text = tag_of(label, names.get(label))
    full = text if len(text) <= LONGEST_TAG else f"{text[: LONGEST_TAG - 1]}…"
    return (full, tag_of(label)) if label in names else (full,)


def draw_proposals(
    color: UInt8Array,
    T_world_camera: Float64Array,
    intrinsics: Intrinsics,
    proposals: Iterable[Scored],
    status: Status | None,
) -> UInt8Array:
    """Return a picture with the 3D proposals of a frame and their scores.

    Proposals without a labelled object are grey and dashed. Parameters and result are those of `draw_frame`.
    """
    items = [(proposal, (f"{proposal.score:.2f}",), proposal.label == 0) for proposal in proposals]
    drawn = _in_view(items, T_world_camera, intrinsics)
    return _draw(color, intrinsics, drawn, status, tinted=True)[0]


def _in_view(
    items: Sequence[tuple[Labelled, tuple[str, ...], bool]], T_world_camera: Float64Array, intrinsics: Intrinsics
) -> list[_Drawn]:
    """Return the drawings of the items in view; each item comes with the texts of its tag and its `dashed` flag."""
    near = may_be_in_view([item.box for item, _, _ in items], T_world_camera, intrinsics)
    chosen = [item for item, possible in zip(items, near, strict=True) if possible]
    wires = wireframes([item.box for item, _, _ in chosen], T_world_camera, intrinsics)
    drawn = []
    for (item, texts, dashed), wire in zip(chosen, wires, strict=True):
        rect_xyxy = wire.rect_xyxy(intrinsics)
        if rect_xyxy is not None:
            drawn.append(_Drawn(color_of(item.label), texts, wire, rect_xyxy, dashed))
    return sorted(drawn, key=lambda one: -one.wire.depth_m)


def _draw(
    color: UInt8Array,
    intrinsics: Intrinsics,
    drawn: list[_Drawn],
    status: Status | None,
    tinted: bool,
    steady: SteadyNames | None = None,
) -> tuple[UInt8Array, list[Rect]]:
    """Return the picture, and the places of its tags."""
    unit = unit_of(intrinsics.width)
    picture = color.copy()
    layer = np.empty_like(color)  # one buffer for all steps: allocating memory costs more than drawing
    if tinted:
        _tint(picture, layer, drawn)
    _draw_behind(picture, layer, drawn, unit)
    for item in drawn:
        if not item.dashed:
            _lines(picture, _fixed(item.wire.front), item.color, _px(FRONT_PX, unit))
    strip_px = _px(STRIP_PX, unit) if status is not None else 0
    tags = _put_tags(picture, drawn, unit, strip_px, steady)
    if status is not None:
        put_strip(picture, status, unit)
    return picture, tags


def _tint(picture: UInt8Array, layer: UInt8Array, drawn: list[_Drawn]) -> None:
    """Tint the sides of visible boxes that face the camera."""
    for wanted, fraction in ((False, SIDE_FRACTION), (True, TOP_FRACTION)):
        np.copyto(layer, picture)
        for item in drawn:
            for face, outline in item.wire.faces if not item.dashed else ():
                if (face == TOP) == wanted:
                    cv2.fillConvexPoly(layer, _fixed(outline), item.color, cv2.LINE_AA, SHIFT)
        _blend(picture, layer, fraction)


def _draw_behind(picture: UInt8Array, layer: UInt8Array, drawn: list[_Drawn], unit: float) -> None:
    """Draw halos, hidden edges and dashed boxes, all of them translucent."""
    np.copyto(layer, picture)
    front, thin, halo = _px(FRONT_PX, unit), _px(THIN_PX, unit), _px(HALO_PX, unit)
    for item in drawn:
        if item.dashed:
            strokes = _fixed(dashes(item.wire.front, DASH_PX * unit, GAP_PX * unit))
            _lines(layer, strokes, DARK, front + halo)
            _lines(layer, strokes, item.color, front)
            continue
        _lines(layer, _fixed(item.wire.back), DARK, thin + halo)
        _lines(layer, _fixed(item.wire.back), item.color, thin)
        _lines(layer, _fixed(item.wire.front), DARK, front + 2 * halo)
    _blend(picture, layer, BEHIND_FRACTION)


def dashes(segments: Float64Array, dash_px: float, gap_px: float) -> Float64Array:
    """Return segments (N, 2, 2) in pixels as dashes (M, 2, 2); each begins and ends with a dash."""
    parts = [np.zeros((0, 2, 2))]
    for start, end in segments:
        length = float(np.hypot(*(end - start)))
        count = max(1, round((length + gap_px) / (dash_px + gap_px)))
        period = (length + gap_px) / count
        from_px = np.arange(count) * period
        fractions = np.stack((from_px, from_px + period - gap_px), axis=1) / max(length, 1e-9)
        parts.append(start + fractions[:, :, None] * (end - start))
    return np.concatenate(parts)


def _put_tags(
    picture: UInt8Array, drawn: list[_Drawn], unit: float, strip_px: int, steady: SteadyNames | None
) -> list[Rect]:
    """Put a tag above each box and return their places; the nearest box is first, and no tag covers another."""
    size_px = _px(tag_px(len(drawn)), unit)
    free = (picture.shape[0] - strip_px, picture.shape[1])
    first = sorted(drawn, key=lambda item: (item.dashed, item.wire.depth_m))
    placed = place_tags([(item.texts, item.rect_xyxy) for item in first], size_px, free, steady)
    for item, tag in zip(first, placed, strict=True):
        if tag is not None:
            put_tag(picture, tag[0], size_px, item.color, item.dashed, tag[1])
    return [tag[1] for tag in placed if tag is not None]


def put_strip(picture: UInt8Array, status: Status, unit: float) -> None:
    """Write the frame number and the numbers of objects into a dark strip at the bottom of a picture (H, W, 3)."""
    height, size_px = _px(STRIP_PX, unit), _px(STRIP_TEXT_PX, unit)
    strip = picture[-height:]
    _blend(strip, np.full_like(strip, DARK), STRIP_FRACTION)
    top = picture.shape[0] - height + (height - round(1.25 * size_px)) // 2
    left = _px(10, unit)
    put_text(picture, f"frame {status.frame}", left, top, size_px, WHITE)
    put_text(picture, f"{status.seen} seen / {status.known} known", left + round(110 * unit), top, size_px, WHITE)


def _blend(picture: UInt8Array, layer: UInt8Array, fraction: float) -> None:
    cv2.addWeighted(layer, fraction, picture, 1.0 - fraction, 0.0, dst=picture)


def _fixed(points: Float64Array) -> npt.NDArray[np.int32]:
    return np.round(points * (1 << SHIFT)).astype(np.int32)


def _lines(picture: UInt8Array, segments: npt.NDArray[np.int32], color: Color, thickness: int) -> None:
    if len(segments):
        cv2.polylines(picture, list(segments), False, color, thickness, cv2.LINE_AA, SHIFT)


def _px(size: float, unit: float) -> int:
    return max(1, round(size * unit))
