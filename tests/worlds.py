"""Random small worlds of planes and boxes, cast ray by ray, and what must hold of a tracker whatever it is shown."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.method.heatmap.kernels.cubes import (
    BLOCK_BITS,
    BLOCK_ROWS,
    CUBE_BITS,
    CUBE_SIDE,
    KEY_BITS,
    KEY_OFFSET,
    keys_of,
)
from cuboid.method.heatmap.voxel_map import MAX_VOTES
from cuboid.method.objects.entry import State
from cuboid.method.proposals.types import Proposals
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import cast, look_at, upright

CAMERA = Intrinsics(68.0, 68.0, 39.5, 29.5, 80, 60)
FLOOR = upright((0, 0), (6, 6, 0.1), z=-0.1)
WALLS = (upright((0, 2.5), (6, 0.1, 2.5)), upright((-2.5, 0), (0.1, 6, 2.5)))
TABLE = upright((0.1, 0.2), (1.2, 0.9, 0.03), 0.1, z=0.45)
NOISE_PER_M = 1.0e-3


class World:
    """A floor, perhaps walls and a table, and things on them.

    Parameters
    ----------
    rng : numpy.random.Generator
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.room: list[Box] = [FLOOR, *(wall for wall in WALLS if rng.random() < 0.5)]
        self.things: list[Box] = []
        self.turn = float(rng.uniform(0, 2 * np.pi))

    def add(self, way: str) -> None:
        """Put a thing of any size on the floor, on a table, beside another one or on top of it."""
        rng = self.rng
        size = np.exp(rng.uniform(np.log(0.02), np.log(1.3), 3)) if rng.random() < 0.2 else rng.uniform(0.06, 0.35, 3)
        table = any(box is TABLE for box in self.room) and rng.random() < 0.5
        x, y, z = (*rng.uniform(-0.5, 0.5, 2), 0.48 if table else 0.0)
        turn = float(rng.uniform(0, np.pi))
        if self.things and way != "alone":
            other = self.things[int(rng.integers(len(self.things)))]
            x, y, low = (float(v) for v in other.center - [0, 0, other.size[2] / 2])
            turn = float(np.arctan2(other.rotation[1, 0], other.rotation[0, 0]))
            if way == "beside":
                step = (other.size[0] + size[0]) / 2 + (0.0 if rng.random() < 0.5 else 0.015)
                x, y, z = x + step * np.cos(turn), y + step * np.sin(turn), low
            else:
                z = low + other.size[2]
        self.things.append(upright((x, y), (float(size[0]), float(size[1]), float(size[2])), turn, z))

    def pose(self, way: str) -> np.ndarray:
        """Return T_world_camera of a camera that goes on round the things, or jumps, or is held in an odd way."""
        rng = self.rng
        self.turn += float(rng.uniform(0.0, 0.15)) if way != "jump" else float(rng.uniform(0.5, 6.0))
        away, high = (1.3, 1.0) if way != "jump" else rng.uniform((0.4, 0.1), (2.2, 1.8))
        at = [0.0, 0.0, 0.2] if way != "jump" else rng.uniform(-0.6, 0.6, 3)
        eye = np.array([away * np.cos(self.turn), away * np.sin(self.turn), high])
        if way == "down":
            return look_at([0.01, 0.0, 1.5], [0.0, 0.0, 0.0])
        T = look_at(eye, at)
        roll = {"upside down": np.pi, "on its side": np.pi / 2}.get(way, 0.0)
        c, s = np.cos(roll), np.sin(roll)
        T[:3, :3] = T[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        return T

    def frame(self, T: np.ndarray, index: int, spoilt: str = "") -> tuple[Frame, np.ndarray]:
        """Return a frame of the world and which box each pixel shows, from 0, -1 none."""
        boxes, rng = [*self.room, *self.things], self.rng
        depth, hit = cast(boxes, T, CAMERA)
        if spoilt == "far and near":
            depth = 10.0 ** rng.uniform(-4, 6, depth.shape)
        elif spoilt == "noise":
            depth = rng.uniform(0, 4, depth.shape) * (rng.random(depth.shape) < 0.7)
        elif spoilt == "one value":
            depth = np.full(depth.shape, rng.uniform(0.2, 3.0))
        elif spoilt == "empty":
            depth = np.zeros(depth.shape)
        else:
            depth = depth + rng.normal(size=depth.shape) * NOISE_PER_M * depth**2 * (depth > 0)
            depth[rng.random(depth.shape) < 0.03] = 0.0
        color = ((hit[..., None] * np.array([53, 97, 31]) + 90) % 256).astype(np.uint8)
        return Frame(index, index / 30, color, depth.astype(np.float32), T), hit


class Proposer:
    """Proposes what each box shows of itself, now and then two as one or one as two, and now and then anything."""

    def __init__(self, rng: np.random.Generator, strays: int) -> None:
        self._rng, self._strays = rng, strays
        self.hit = np.full((CAMERA.height, CAMERA.width), -1)
        self.first = 0

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of the frame that `hit` is of."""
        rng, found = self._rng, []
        numbers = [k for k in np.unique(self.hit).tolist() if k >= self.first]
        for k in numbers:
            draw = rng.random()
            mask = self.hit == k
            if draw < 0.1:
                mask = mask | (self.hit == numbers[int(rng.integers(len(numbers)))])
            elif draw < 0.2:
                mask = mask & (np.arange(mask.shape[1]) < np.flatnonzero(mask.any(0)).mean())
            if draw < 0.9 and mask.any():
                found.append(mask)
        for _ in range(self._strays):
            x, y = int(rng.integers(0, 70)), int(rng.integers(0, 50))
            mask = np.zeros(self.hit.shape, bool)
            mask[y : y + int(rng.integers(1, 40)), x : x + int(rng.integers(1, 40))] = True
            found.append(mask)
        spans = [(np.flatnonzero(m.any(0)), np.flatnonzero(m.any(1))) for m in found]
        boxes = [(c[0], r[0], c[-1] + 1, r[-1] + 1) for c, r in spans]
        masks = tuple(m[y0:y1, x0:x1].astype(np.uint8) for m, (x0, y0, x1, y1) in zip(found, boxes, strict=True))
        scores = rng.uniform(0.2, 1.0, len(boxes)).astype(np.float32)
        return Proposals(np.array(boxes, np.int32).reshape(-1, 4), scores, masks)


def assert_boxes_are_sound(boxes: list[Box]) -> None:
    """Boxes are finite, have three sizes above 0, and axes that are a right-handed rotation."""
    if not boxes:
        return
    center, size, R = (np.array([getattr(b, name) for b in boxes]) for name in ("center", "size", "rotation"))
    assert np.isfinite(center).all()
    assert np.isfinite(size).all()
    assert (size > 0).all(), size.min()
    np.testing.assert_allclose(np.swapaxes(R, 1, 2) @ R, np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-6)


class Watch:
    """Looks at a tracker after each step, and remembers which labels there were."""

    def __init__(self, tracker: PosedTracker) -> None:
        self._tracker = tracker
        self._number_of: dict[int, int] = {}
        self._ended: set[int] = set()
        self.labelled = 0

    def check_map(self) -> None:
        """Look at the map of objects, the map of points, and the planes."""
        self._objects()
        self._labels()
        self._voxels()
        self._planes()

    def _objects(self) -> None:
        tracker, store = self._tracker, self._tracker._map.store
        living = store.living()
        assert_boxes_are_sound([o.box for o in living])
        numbers = [o.number for o in living]
        assert numbers == sorted(set(numbers))
        known = np.flatnonzero(~np.isnan(store.boxes).any(1))
        assert known.tolist() == numbers
        assert np.isnan(store.boxes[np.setdiff1d(np.arange(len(store.boxes)), known)]).all()
        if living:
            np.testing.assert_array_equal(store.boxes[known], pack([o.box for o in living]))
        for number in store.affinity.objects():
            for other in store.affinity.partners(number):
                assert store.affinity.of(number, other) is not None
                assert number in store.affinity.partners(other)
                assert number != other
                assert {number, other} <= set(numbers)
        limit = tracker.config.max_size_m * (1 + 1e-6)
        for o in store.confirmed():
            assert o.box.size.max() <= limit, "a labelled object is larger than it may be"
        for shown in tracker.objects:
            assert 0.0 <= shown.score <= 1.0
            assert 0.0 <= shown.heat <= 1.0
            assert shown.plane is None or 0 <= shown.plane < len(tracker.planes)
            assert shown.points > 0
            assert shown.frames_seen >= 0

    def _labels(self) -> None:
        store = self._tracker._map.store
        labelled = store.confirmed()
        assert len({o.label for o in labelled}) == len(labelled)
        assert all(o.state is State.CONFIRMED and o.label > 0 for o in labelled)
        for o in labelled:
            assert self._number_of.setdefault(o.label, o.number) == o.number, "a label went to another object"
        living = {o.label for o in labelled}
        assert not living & self._ended, "a label came back"
        self._ended |= self._number_of.keys() - living
        merged = [label for o in store._objects.values() for label in o.merged_labels]
        assert len(set(merged)) == len(merged)
        assert not set(merged) & living
        assert all(label > o.label > 0 for o in store._objects.values() for label in o.merged_labels)
        retired = {o.label for o in store._objects.values() if o.state is State.RETIRED}
        assert living | set(merged) | retired == set(range(1, store._next_label)), "a label was lost"
        assert store._next_label - 1 >= self.labelled
        self.labelled = store._next_label - 1

    def _voxels(self) -> None:
        voxels, store = self._tracker._voxels, self._tracker._map.store
        used = slice(0, voxels.stored.blocks * BLOCK_ROWS)
        owner, confidence = voxels.stored.owner[used], voxels.stored.points.confidence[used]
        numbers = [o.number for o in store.living()]
        assert np.isin(owner, [0, *numbers]).all(), "points of an object that is no more"
        assert (confidence <= MAX_VOTES).all()
        np.testing.assert_array_equal(owner > 0, confidence > 0)
        alive = voxels.stored.living()
        fine = voxels.stored.living(fine=True)
        assert len(alive) + len(fine) == voxels.stored.alive
        assert not owner[fine].any(), "whose they are is told by the voxels around them alone"
        assert (voxels.stored.hits[alive] > 0).all()
        assert np.isfinite(voxels.stored.weight(alive)).all()
        for number in numbers:
            assert voxels.stored.rows_of(number).tolist() == alive[owner[alive] == number].tolist()
        marked = np.flatnonzero(voxels.stored.points.mark[used])
        assert not voxels.stored.cubes.bits[voxels.stored.cubes.cube_of[marked >> BLOCK_BITS]].any(), (
            "a table leads to a cell"
        )
        assert not owner[marked].any()
        points = self._tracker.map_points()
        assert len(points.xyz) == len(points.label)
        every, _ = voxels.stored.spread(alive)
        assert len(every) <= len(points.xyz) <= len(every) + len(fine)
        assert self._tracker.points_known == voxels.stored.alive
        assert np.isin(points.label, [0, *(o.label for o in store.confirmed())]).all()

    def _planes(self) -> None:
        tracker, planes = self._tracker, self._tracker._planes.planes
        assert len({p.identity for p in planes}) == len(planes)
        assert [p.index for p in planes] == list(range(len(planes)))
        for p in planes:
            assert tracker._planes.find(p.identity) is (p if p.in_use else None)
            assert np.linalg.norm(p.normal) == np.float64(1.0) or abs(np.linalg.norm(p.normal) - 1.0) < 1e-9
            assert np.isfinite(p.offset)
            assert np.isfinite(p.mean).all()
        if tracker.up is not None:
            assert abs(np.linalg.norm(tracker.up) - 1.0) < 1e-6
        for shown in tracker.planes:
            assert np.isfinite(shown.extent).all()

    def result(self, frame: Frame, result: FrameResult) -> None:
        """Look at what a frame was answered with."""
        height, width = frame.depth_m.shape
        labels = {o.label for o in self._tracker.objects}
        assert result.index == frame.index
        assert result.objects_known == len(labels)
        assert np.isfinite(result.heat).all()
        assert result.heat.min(initial=0.0) >= 0.0
        assert result.heat.max(initial=0.0) <= 1.0
        assert_boxes_are_sound([p.box for p in result.proposals] + [s.box for s in result.sightings])
        for rect in [p.rect_xyxy for p in result.proposals] + [s.rect_xyxy for s in result.sightings]:
            assert 0 <= rect[0] < rect[2] <= width, rect
            assert 0 <= rect[1] < rect[3] <= height, rect
        limit = self._tracker.config.max_size_m
        assert all(p.box.size.max() <= limit for p in result.proposals), "a frame's own box is larger than it may be"
        assert all(s.box.size.max() <= limit * (1 + 1e-6) for s in result.sightings), "a sighting is larger"
        assert {p.label for p in result.proposals} <= labels | {0}, "a proposal is of an object that is no more"
        seen = [s.label for s in result.sightings]
        assert seen == sorted(set(seen))
        assert set(seen) <= labels
        for s in result.sightings:
            assert 0.0 <= s.visible <= 1.0
            assert s.iou is None or 0.0 <= s.iou <= 1.0 + 1e-9


def cubes_of(voxels: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16]]:
    """Return the keys of the cubes (N,) that voxels of the world (N, 3) lie in, and which of its voxels they are."""
    within = voxels & (CUBE_SIDE - 1)
    inside = (within[:, 0] << (2 * CUBE_BITS)) | (within[:, 1] << CUBE_BITS) | within[:, 2]
    return keys_of(voxels >> CUBE_BITS), inside.astype(np.uint16)


def voxels_of(keys: npt.NDArray[np.int64], voxel: npt.NDArray[np.uint16]) -> npt.NDArray[np.int64]:
    """Return the voxels of the world (N, 3) that are these in cubes (N,) of these keys: the way back."""
    mask, side = (1 << KEY_BITS) - 1, CUBE_SIDE - 1
    cube = np.stack([(keys >> (2 * KEY_BITS)) & mask, (keys >> KEY_BITS) & mask, keys & mask], 1) - KEY_OFFSET
    inside = np.stack([voxel >> (2 * CUBE_BITS), (voxel >> CUBE_BITS) & side, voxel & side], 1)
    return np.asarray((cube << CUBE_BITS) + inside)
