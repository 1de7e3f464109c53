"""The scope of an evaluation: objects that must be found, objects that may be, boxes that count neither way.

An object must be found in a frame that shows more than `MUST_SEE_FRACTION` of it. In other frames neither its absence
nor its presence counts, as with heavily occluded objects in KITTI (Geiger, Lenz, Urtasun, CVPR 2012). The same holds
for objects that are not judged and for ignored places. A found box that pairs with no object to be found is left out if
it lies on one of those, or if its centre is outside the judged region.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.overlap import intersection_matrix, iou_matrix, pack
from cuboid.lab.evaluation.matching import FrameOverlap, match
from cuboid.lab.evaluation.result import BoxRows, IntArray
from cuboid.lab.evaluation.truth import Truth, TruthObject

BoolArray = npt.NDArray[np.bool_]

# Visible fraction of an object above which a frame must find it: at a tenth, a mug still has about a hundred pixels.
MUST_SEE_FRACTION = 0.1
# Minimum IoU of a found object; a box that pairs with an object at this IoU is judged, wherever it lies.
FOUND_IOU = 0.25
# A box lies on something that does not count if at least half of its volume does (COCO's rule for crowds uses the same
# fraction of the found box: Lin et al., ECCV 2014), or if the IoU of both is at least `FOUND_IOU`.
LIES_ON_FRACTION = 0.5
# Rotations about the third axis at which the square box of a round object is compared with a found box: a quarter turn
# in steps of 5 degrees. The best one is at most 2.5 degrees off, which costs less than 0.04 of IoU.
TURNS_RAD = np.radians(np.arange(0.0, 90.0, 5.0))


@dataclass(frozen=True, slots=True)
class Boxes:
    """Overlaps of found boxes with everything in the truth.

    Attributes
    ----------
    iou : (N, G) float64
        IoU with the judged objects.
    on_judged : (N, G) bool
        Whether the box lies on the judged object.
    left_out : (N,) bool
        Whether the box lies outside the judged region or on something that never counts.
    """

    iou: Float64Array
    on_judged: BoolArray
    left_out: BoolArray

    def of(self, rows: slice) -> Boxes:
        """Return the entries of some of the boxes."""
        return Boxes(self.iou[rows], self.on_judged[rows], self.left_out[rows])


class Scope:
    """The judged objects of a truth, and everything else that affects the evaluation.

    Parameters
    ----------
    truth : Truth
    frames : (T,) int64
        Frames of the recording that are judged.

    Attributes
    ----------
    objects : tuple of TruthObject
        Judged objects.
    packed : (G, 15) float64
        Final boxes of the judged objects.
    frames : (T,) int64
    shown : (T, G) float64 or None
        Visible fractions of the judged objects in the judged frames.
    """

    def __init__(self, truth: Truth, frames: IntArray) -> None:
        judged = [k for k, item in enumerate(truth.objects) if item.judged]
        aside = [item.box for item in truth.objects if not item.judged]
        self.objects: tuple[TruthObject, ...] = tuple(truth.objects[k] for k in judged)
        self.packed = pack([item.box for item in self.objects])
        self.frames = frames
        self.shown = None if truth.visibility is None else truth.visibility[frames][:, judged]
        self._aside = pack([*aside, *truth.ignored])
        self._region = truth.region
        self._round = np.flatnonzero([item.round for item in self.objects])
        self._truth = truth
        self._gone = np.array([item.id in truth.gone for item in self.objects], bool)
        self._moves = any(item.path is not None for item in truth.objects)

    def _in_frame(self, frame: int) -> tuple[Float64Array, Float64Array]:
        """Return the boxes in a frame of the judged objects, and of everything that counts neither way."""
        aside = [item.at(frame) for item in self._truth.objects if not item.judged]
        return pack([item.at(frame) for item in self.objects]), pack([*aside, *self._truth.ignored])

    def boxes(self, found: Float64Array, frame: int | None = None) -> Boxes:
        """Return overlaps of found boxes (N, 15) with the truth in a frame; by default at the end."""
        packed, aside = (self.packed, self._aside) if frame is None else self._in_frame(frame)
        on_aside = _stands_on(found, aside, iou_matrix(found, aside)).any(1)
        outside = np.zeros(len(found), bool)
        if self._region is not None:
            outside = ~self._region.contains(found[:, :3])
        iou = self._iou(found, packed)
        return Boxes(iou, _stands_on(found, packed, iou), on_aside | outside)

    def _iou(self, found: Float64Array, packed: Float64Array) -> Float64Array:
        """Return the IoU (N, G) of found boxes (N, 15) with those of the judged objects (G, 15).

        For a round object it is the maximum over rotations about the third axis, as in Objectron for cups and bottles
        (Ahmadyan et al., CVPR 2021): the yaw of a round object has no meaning.
        """
        iou = iou_matrix(found, packed)
        for angle in TURNS_RAD[1:] if len(self._round) else ():
            turned = _turned(packed[self._round], angle)
            iou[:, self._round] = np.maximum(iou[:, self._round], iou_matrix(found, turned))
        return iou

    def must_map(self) -> BoolArray:
        """Return which judged objects (G,) the map must contain: those that at least one judged frame must find."""
        if self.shown is None:
            return ~self._gone
        return np.asarray((self.shown > MUST_SEE_FRACTION).any(0) & ~self._gone)

    def frame_overlaps(self, rows: BoxRows) -> list[FrameOverlap]:
        """Return for each judged frame the objects that must be found, and the found boxes that count.

        `found` of the frames are indices into the sorted distinct labels of `rows`.
        """
        assert self.shown is not None
        _, number = np.unique(rows.label, return_inverse=True)
        lie = None if self._moves else self.boxes(rows.boxes)
        start, end = (np.searchsorted(rows.frame, self.frames, side) for side in ("left", "right"))
        overlaps = []
        for t, frame in enumerate(self.frames.tolist()):
            in_frame = slice(int(start[t]), int(end[t]))
            must = np.flatnonzero(self.shown[t] > MUST_SEE_FRACTION)
            may = (self.shown[t] > 0) & (self.shown[t] <= MUST_SEE_FRACTION)
            placement = self.boxes(rows.boxes[in_frame], frame) if lie is None else lie.of(in_frame)
            iou = placement.iou[:, must].T
            counts = counted(iou, placement.left_out | placement.on_judged[:, may].any(1))
            overlaps.append(FrameOverlap(frame, must, number[in_frame][counts], iou[:, counts]))
        return overlaps


def _turned(boxes: Float64Array, angle_rad: float) -> Float64Array:
    """Return boxes (N, 15) rotated about their third axes."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = boxes.copy()
    turned[:, 6:] = (boxes[:, 6:].reshape(-1, 3, 3) @ turn).reshape(-1, 9)
    return turned


def counted(iou: Float64Array, left_out: BoolArray) -> BoolArray:
    """Return which found boxes count, (P,): those that pair with a row of `iou` (G, P), and those not left out."""
    result = ~left_out
    result[[j for _, j in match(iou, FOUND_IOU)]] = True
    return result


def _stands_on(found: Float64Array, things: Float64Array, iou: Float64Array) -> BoolArray:
    """Return for found boxes (N, 15) and things (M, 15) whether a box lies on a thing, (N, M)."""
    common = intersection_matrix(found, things)
    volume = found[:, 3:6].prod(1)[:, None]
    return np.asarray((common > 0) & ((common >= LIES_ON_FRACTION * volume) | (iou >= FOUND_IOU)))
