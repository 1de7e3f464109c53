"""Objects that depth does not part from what is around them: chosen regions of color and depth, followed over views.

A sheet on a wall, a box beside another one or a thing in a hand may have no segment of its own in the depth image. The
source `regions` shows it in many views, and false regions seldom repeat at one place. So a region starts an object
without voxels, regions of later views are matched to it by its predicted rectangle, and its probability is the mean of
those of its regions, where a view without one counts as 0. Labelled objects of the map that own its pixels are its
rivals: it is reported in their place if it is clearly more probable, and else not at all. If it repeatedly has the
rectangle of one of them, it is that one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.limits import SAMPLE_POINTS
from cuboid.ground.core.observation import Observation
from cuboid.ground.core.results import Sighting
from cuboid.ground.core.tolerances import MIN_READINGS, NEAREST_M, OUTLIER_FRACTION
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.method.boxes.fit import Resting, fit_boxes
from cuboid.method.objects.box_without_depth import Planes, box_of
from cuboid.method.objects.confirmation import leads, prevails
from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth
from cuboid.method.objects.naming import SAME_IOU
from cuboid.method.objects.rectangles import distance_along, is_cut_off, match_views, predict, ray_through, size_at
from cuboid.method.objects.store import ObjectStore
from cuboid.method.objects.validity import too_large
from cuboid.method.objects.visibility import Visibility
from cuboid.method.objects.without_depth import (
    DIRECTION_RAD,
    DIRECTION_SIZE,
    MISSED_FRACTION,
    SEEN_FRACTION,
    merge_doubles,
    met_in_map,
    retire_others,
)
from cuboid.method.proposals.types import Proposals
from cuboid.method.surfaces.frame_segments import points_of
from cuboid.method.surfaces.planes import PlaneTracker

# A region is a view of an object if its rectangle overlaps the predicted one by this IoU.
REGION_FOLLOW_IOU = 0.4
# A region and a labelled object that share at least this fraction of the pixels of one of them are rivals.
RIVAL_FRACTION = 0.5
# Smallest probability of a region that starts an object: more likely a whole thing than not.
MIN_START = 0.5
# Standard deviation of the distance of a region, from the median of its readings, as a fraction of the distance.
REGION_DISTANCE_FRACTION = 0.03
# An object without a label is forgotten if its probability is below this after views of this weight.
UNLIKELY, MIN_LOOKS = 0.15, 2.0


class RegionViews(NamedTuple):
    """The chosen regions of a frame.

    Attributes
    ----------
    rects_xyxy : (N, 4) float64
        Rectangles in pixels of the full image.
    probabilities : (N,) float64
        Of showing one whole thing, 0..1.
    depth_m : (N,) float64
        Median depth of its readings, 0: too few.
    rivals : list of tuple of int
        Numbers of the labelled objects with which it shares much of its pixels, or of theirs.
    boxes : list of Box
        Upright box of its readings in the map; of a region with too few, a box that has no meaning.
    """

    rects_xyxy: Float64Array
    probabilities: Float64Array
    depth_m: Float64Array
    rivals: list[tuple[int, ...]]
    boxes: list[Box]


def region_views(
    found: Proposals, owner: npt.NDArray[np.int32], seen: Observation, labelled: Sequence[int], up: Float64Array
) -> RegionViews:
    """Return what a frame's regions show.

    Parameters
    ----------
    found : Proposals
        From the source `regions`.
    owner : (h, w) int32
        Number of the object that owns each working pixel, 0: none.
    seen : Observation
    labelled : sequence of int
        Numbers of the reported objects.
    up : (3,) float64
        In the map.
    """
    clouds: list[Float64Array] = []
    counts = np.zeros((len(found), 1 + max([int(owner.max(initial=0)), *labelled])))
    medians, pixels, step = np.zeros(len(found)), np.zeros(len(found)), found.mask_step
    # Rows and columns of the full image at the working pixels.
    v, u = (
        np.arange(n) * seen.image.step + phase for n, phase in zip(owner.shape, seen.image.phase[::-1], strict=True)
    )
    for k, (rect, mask) in enumerate(zip(found.boxes_xyxy.tolist(), found.masks or (), strict=True)):
        x0, y0, x1, y1 = rect
        rows, columns = np.flatnonzero((v >= y0) & (v < y1)), np.flatnonzero((u >= x0) & (u < x1))
        covers = mask[np.ix_((v[rows] - y0) // step, (u[columns] - x0) // step)] > 0
        owners = owner[np.ix_(rows, columns)][covers]
        counts[k], pixels[k] = np.bincount(owners, minlength=counts.shape[1]), len(owners)
        flat = (rows[:, None] * owner.shape[1] + columns)[covers]
        readings = seen.image.depth_m.ravel()[flat]
        flat, readings = flat[readings > 0], readings[readings > 0]
        medians[k] = np.median(readings) if len(readings) >= MIN_READINGS else 0.0
        sample = flat[:: 1 + len(flat) // SAMPLE_POINTS]
        clouds.append(points_of(sample, seen.image, seen.T_world_camera) if len(flat) else np.zeros((1, 3)))
    sizes = np.bincount(owner.ravel(), minlength=counts.shape[1])
    shared = counts / np.maximum(np.minimum(sizes, pixels[:, None]), 1.0)
    rivals = [tuple(number for number in labelled if row[number] >= RIVAL_FRACTION) for row in shared]
    rests: list[Resting] = [(up, None)] * len(clouds)
    boxes = fit_boxes(np.concatenate([np.zeros((0, 3)), *clouds]), list(map(len, clouds)), rests, OUTLIER_FRACTION)
    rects, probabilities = found.boxes_xyxy.astype(np.float64), found.scores.astype(np.float64)
    return RegionViews(rects, probabilities, medians, rivals, boxes)


class ByRegions:
    """Finds and follows objects in the regions of frames; the store contains them.

    Parameters
    ----------
    store : ObjectStore
    config : TrackerConfig
        Range of the sensor, and the smallest probability of an object with a label.
    planes : PlaneTracker
        What lies beneath one of its planes is furniture.
    supports : Planes
        Up and the supporting planes, for the boxes.
    """

    def __init__(self, store: ObjectStore, config: TrackerConfig, planes: PlaneTracker, supports: Planes) -> None:
        self._store, self._config, self._planes, self._supports = store, config, planes, supports
        # Rectangles of the objects in the last frame with regions, by number, until its sightings are reported.
        self._hit: dict[int, Float64Array] = {}

    def update(self, found: RegionViews, shown: Sequence[tuple[MapObject, Visibility]], seen: Observation) -> None:
        """Update the objects with the regions of a frame.

        Parameters
        ----------
        found : RegionViews
        shown : sequence of (MapObject, Visibility)
            The reported objects of the map that the frame shows.
        seen : Observation
        """
        entries = self._store.by_regions()
        views = [predict(entry.center, entry.size_m, seen) for entry in entries]
        partner = match_views(views, found.rects_xyxy, REGION_FOLLOW_IOU)
        self._hit = {}
        for k, (entry, view) in enumerate(zip(entries, views, strict=True)):
            if k in partner:
                self._add_view(entry, found, partner[k], seen)
            elif view is not None and view.visible >= MISSED_FRACTION:
                self._store.add_look(entry, 0.0, view.visible, entry.rivals)
        for k in sorted({*range(len(found.rects_xyxy))} - {*partner.values()}):
            self._start(found, k, seen)
        self._join_map(shown)
        merge_doubles(self._store, self._store.by_regions(), self._hit, seen)
        self._forget_unlikely()
        for entry in self._store.by_regions():
            if entry.number not in self._hit or not self._prevails(entry):
                continue
            box, _ = box_of(entry, self._supports)
            if self._planes.has_plane_on_top(box):
                self._store.retire(entry)
            elif not entry.confirmed and not too_large(box, self._config):
                self._store.confirm(entry)
        better = [entry for entry in self._store.by_regions() if entry.label and self._prevails(entry)]
        self._store.replace({number for entry in better for number in entry.rivals})

    def _prevails(self, entry: ObjectWithoutDepth) -> bool:
        return prevails(entry, self._store.rivals_of(entry), self._config)

    def _add_view(self, entry: ObjectWithoutDepth, found: RegionViews, k: int, seen: Observation) -> None:
        rect, z = found.rects_xyxy[k], float(found.depth_m[k])
        self._store.add_look(entry, float(found.probabilities[k]), 1.0, found.rivals[k])
        self._store.add_hit(entry, 1.0, seen.keyframe)
        direction, size_rad = ray_through(rect, seen)
        known_m = max(float(np.linalg.norm(entry.center - seen.eye)), NEAREST_M)
        distance_m = distance_along(direction, z, seen) if z > 0.0 else known_m
        along = np.outer(direction, direction)
        information = 1.0 / (distance_m * max(DIRECTION_RAD, DIRECTION_SIZE * size_rad)) ** 2 * (np.eye(3) - along)
        if z > 0.0:
            information = information + 1.0 / (REGION_DISTANCE_FRACTION * distance_m) ** 2 * along
        self._store.add_ray(entry, information, information @ (seen.eye + distance_m * direction))
        if z > 0.0 and not is_cut_off(rect, seen):
            self._store.add_size(entry, size_at(rect, z, seen), distance_m, 1.0)
            self._store.add_direction(entry, -direction)
            self._store.show_box(entry, found.boxes[k], float(found.probabilities[k]))
        self._hit[entry.number] = rect

    def _start(self, found: RegionViews, k: int, seen: Observation) -> None:
        """Start an object if a region is not cut off, and is probably a whole thing, more so than labelled objects."""
        rect, z = found.rects_xyxy[k], float(found.depth_m[k])
        if found.probabilities[k] < MIN_START or is_cut_off(rect, seen):
            return
        if not leads(float(found.probabilities[k]), self._store.all_of(found.rivals[k])):
            return
        if not 0.0 < z <= self._config.max_depth_m:
            return
        direction, _ = ray_through(rect, seen)
        guess = 1e-6 * np.eye(3)  # makes the position defined before the first region, which outweighs it
        place = seen.eye + distance_along(direction, z, seen) * direction
        entry = self._store.add_without_depth(guess, guess @ place, seen.frame, by_regions=True)
        self._add_view(entry, found, k, seen)

    def _join_map(self, shown: Sequence[tuple[MapObject, Visibility]]) -> None:
        """End objects that repeatedly have the rectangle of an object of the map: that one gets the older label."""
        for entry, partner in met_in_map(self._store, self._store.by_regions(), self._hit, shown):
            self._store.join_map(entry, partner)
            self._store.retire(entry)

    def _forget_unlikely(self) -> None:
        """Retire unlikely objects without a label, and the least likely objects beyond the limit."""
        entries = self._store.by_regions()
        likely = [o for o in entries if o.label or o.looks < MIN_LOOKS or o.score >= UNLIKELY]
        retire_others(self._store, entries, sorted(likely, key=lambda o: (-bool(o.label), -o.score, o.number)))

    def sightings(self, shown: Sequence[Sighting], seen: Observation) -> tuple[Sighting, ...]:
        """Return the sightings of a frame, including those of these objects, by label."""
        found, rects = list(shown), np.array([sighting.rect_xyxy for sighting in shown]).reshape(-1, 4)
        for entry in sorted(self._store.by_regions(), key=lambda o: o.label):
            if not entry.label or not self._prevails(entry):
                continue
            view = predict(entry.center, entry.size_m, seen)
            if view is None or view.visible < SEEN_FRACTION:
                continue
            rect = self._hit.get(entry.number, view.rect_xyxy)
            if len(rects) and rect_iou_matrix(rect[None], rects).max() >= SAME_IOU:
                continue
            rects = np.concatenate([rects, rect[None]])
            self._store.record_seen([entry], seen.frame)
            values = entry.label, box_of(entry, self._supports)[0], None, view.visible, rect
            found.append(Sighting(*values, probability=entry.score))
        self._hit = {}
        return tuple(sorted(found, key=lambda sighting: sighting.label))
