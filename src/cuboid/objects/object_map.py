"""The map of objects: grown from the map's clusters, matched by each frame's boxes, labelled for life."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from cuboid.config import TrackerConfig
from cuboid.frame import Float32Array, Float64Array, UInt8Array
from cuboid.geometry.box import Box
from cuboid.geometry.overlap import overlap_min_matrix, pack
from cuboid.geometry.se3 import transform
from cuboid.heatmap.voxel_map import REFUSED, Rows, VoxelMap
from cuboid.objects.bonds import Bonds
from cuboid.objects.boxing import Boxing
from cuboid.objects.entry import MapObject
from cuboid.objects.index import ObjectIndex
from cuboid.objects.ownership import CONTACT_SHARE, Piece, bends_around, gap_m, owners_of, share_out
from cuboid.objects.parts import (
    FRAGMENT_GAP_M,
    PART_REACH,
    PART_REACH_M,
    PART_SHARE,
    TOUCH_M,
    is_part,
)
from cuboid.objects.patience import beside, is_ready, patience, times_alone
from cuboid.objects.splits import Splits, larger_side
from cuboid.objects.validity import is_object
from cuboid.objects.visibility import in_view
from cuboid.surfaces.clusters import LOOKED_AT, MapCluster, is_back, map_clusters
from cuboid.surfaces.planes import PlaneTracker
from cuboid.working import WorkingImage

# Two labelled objects that touch as one in so many looks at the map are one.
MERGE_LOOKS = 6
# ... at once when this share of the smaller one's box lies in the other's: drift made two of one.
MERGE_OVERLAP = 0.5
# Two parts whose boxes have less than this share of the smaller one in common may be two things.
APART_OVERLAP = 0.3
# A part that stands apart in so many looks is an object of its own.
SPLIT_LOOKS = 8
# Every so many looks at the map are wide: they take in all of it, or all that was seen since the last wide look where
# the map has more rows than this: such a look takes 0.1 s.
WIDE_EVERY, WHOLE_ROWS = 8, 1 << 20
# Objects and contested clusters larger than this (a quarter of a square metre at 1 cm) wait for a wide look at the
# map: they change slowly, and each object keeps what it has till then.
LARGE_VOXELS = 2500
# A new cluster that lies to this share along what was refused is more of that.
REFUSED_SHARE = 0.05
# An object that was not found in so many wide looks is retired.
RETIRE_LOOKS = 3
# A labelled object that holds up a plane in so many looks is retired: a shelf whose board was not seen at first. The
# plane lies so far above the one that it stands on, metres: the boards of shelves and the tops of tables do, and the
# patches of one desk, which noise takes for several planes, do not.
SUPPORT_LOOKS, SUPPORT_M = 2, 0.2
# Beyond so many times the longest reach of a box others are no neighbours of it: a little more than is asked for.
NEAR_SIZES = 2.01
# Objects beyond so many times the range of depth are not looked for: too far to tell even their colors.
FAR = 2.0
# Of objects farther than this from all that was seen, metres, nothing has changed.
AROUND_M = 1.0
# What stands where a retired object stood is that object, when this share of the smaller box is common.
RETURN_OVERLAP = 0.3


class ObjectMap:
    """All objects ever found, by number; labels are given in order of confirmation and never reused.

    Parameters
    ----------
    config : TrackerConfig
    voxels : VoxelMap
    planes : PlaneTracker
    """

    def __init__(self, config: TrackerConfig, voxels: VoxelMap, planes: PlaneTracker) -> None:
        self._config = config
        self._voxels = voxels
        self._planes = planes
        self._objects: dict[int, MapObject] = {}
        self._index = ObjectIndex()
        self._boxing = Boxing(voxels, planes)
        self.bonds = Bonds()
        self.splits = Splits()
        self._together: dict[tuple[int, int], int] = {}
        self._next_number = 1
        self._next_label = 1
        self._looks = 0
        self._last_look = self._last_wide = -1
        # Objects that were in the picture since the last wide look.
        self._viewed: set[int] = set()
        # Objects that have no points in the map.
        self._lost: set[int] = set()
        # Objects without a label whose patience is known.
        self._weighed: set[int] = set()

    def alive(self) -> list[MapObject]:
        """Return all objects that are not retired, confirmed or not, in order of their numbers."""
        return [o for o in self._objects.values() if not o.retired]

    def confirmed(self) -> list[MapObject]:
        """Return the objects of the map that have a label, by label."""
        return sorted((o for o in self.alive() if o.confirmed), key=lambda o: o.label)

    @property
    def labelled(self) -> int:
        """How many objects of the map have a label."""
        return len(self._objects) - len(self._index.unlabelled) - len(self._index.retired)

    def in_view(self, image: WorkingImage, T_camera_world: Float64Array) -> list[MapObject]:
        """Return the objects, confirmed or not, whose boxes reach into the picture, none too far to see, by number."""
        far_m = FAR * self._config.max_depth_m
        numbers = in_view(self._index.boxes, image, T_camera_world, far_m).tolist()
        self._viewed.update(numbers)
        return [self._objects[number] for number in numbers]

    def settle(self, frame: int) -> None:
        """Bring the objects up to date with the map: those seen of late, and now and then all.

        Only points seen since the last look and the objects they belong to are clustered, so that the cost follows
        from the view, not from the map. What was refused before stays refused until a wide look sees all of it.
        """
        voxels = self._voxels
        wide = self._looks % WIDE_EVERY == 0
        whole = wide and (self._looks == 0 or voxels.count <= WHOLE_ROWS)
        since = 0 if whole else 1 + (self._last_wide if wide else self._last_look)
        self._looks += 1
        self._last_look, self._last_wide = frame, frame if wide else self._last_wide
        if wide:
            voxels.forgive(since)
        count = self._next_number
        asleep = np.zeros(count, np.uint8) if wide else self._index.large(count, LARGE_VOXELS)
        # What was taken away is in the picture, and no point of it is seen.
        also = sorted(self._viewed.intersection(self._objects)) if wide else []
        self._viewed = set() if wide else self._viewed
        rows, touched = voxels.solid_hot_rows(self._config.hot, since, asleep, also)
        clusters = map_clusters(rows, voxels, self._planes, self._config)
        pieces, refused = self._divide(clusters, wide, whole, asleep)
        seen = np.flatnonzero(touched).tolist()
        voxels.release(seen)
        for rows in refused:
            voxels.give(rows, REFUSED)
        for number, own in pieces.items():
            if number:
                self._update(self._objects[number], own, frame)
        for piece in pieces.get(0, []):
            self._start(piece, frame)
        self._lost = {n for n in self._lost.union(seen) if n in self._objects and n not in pieces}
        if wide:
            missing = self.alive() if whole else [self._objects[n] for n in sorted(self._lost)]
            self._age([e for e in missing if e.number < count and e.number not in pieces and not e.retired])
        self._split(frame)
        self._weigh([*seen, *range(count, self._next_number)])
        self.confirm()

    def carry(self, moved: Mapping[int, Float64Array]) -> None:
        """Move the map, and each object with the keyframe that most of its points hang on; look at all of it next.

        Parameters
        ----------
        moved : mapping of int to (4, 4) float64
            T_new_old of each keyframe whose surroundings move.
        """
        voxels = self._voxels
        anchor_of = {n: int(np.bincount(voxels.anchor[rows]).argmax()) for n, rows in voxels.owned().items()}
        voxels.carry(moved)
        owned = voxels.owned()
        for number, entry in self._objects.items():
            T = moved.get(anchor_of.get(number, -1))
            if T is not None:
                R, t = T[:3, :3], T[:3, 3]
                entry.box = Box(R @ entry.box.center + t, entry.box.size, R @ entry.box.rotation)
                entry.points = transform(T, entry.points).astype(np.float32)
            if number in owned:
                entry.points, entry.colors = voxels.xyz(owned[number]), voxels.rgb(owned[number])
            self._index.note(entry)
        self._looks = 0

    def _divide(
        self, clusters: Sequence[MapCluster], wide: bool, whole: bool, asleep: UInt8Array
    ) -> tuple[dict[int, list[Piece]], list[Rows]]:
        """Give each cluster to its owner; share contested ones out unless their owners turn out to be one.

        Returns the pieces by owner, 0 for those of no one yet, and the rows that belong to no object.
        """
        pieces: dict[int, list[Piece]] = defaultdict(list)
        holding: dict[int, list[Piece]] = defaultdict(list)
        refused: list[Rows] = []
        for cluster in clusters:
            owner = self._voxels.owner[cluster.rows]
            if cluster.furniture or (not whole and self._joins_refused(cluster.rows, owner, asleep)):
                # An object that touches a wall keeps what it has.
                for number in owners_of(cluster.rows, self._voxels, self._objects):
                    if self._objects[number].confirmed:
                        own = Piece(number, cluster.rows[owner == number], cluster.plane)
                        (holding if self._holds_up(own) else pieces)[number].append(own)
                refused.append(cluster.rows[owner <= 0])
                continue
            self._give(cluster, pieces, wide)
        for number, parts in holding.items():
            if self._is_support(number, parts):
                refused.extend(part.rows for part in parts)
                pieces.pop(number, None)
            else:
                pieces[number].extend(parts)
        return pieces, refused

    def _holds_up(self, own: Piece) -> bool:
        """Tell whether a piece of an object holds up a plane, or is the back of a shelf."""
        if own.plane is None:
            return False
        points = self._voxels.xyz(own.rows[:: 1 + len(own.rows) // LOOKED_AT])
        return self._planes.holds_up(points, own.plane, SUPPORT_M) or is_back(points, own.plane, self._planes)

    def _is_support(self, number: int, parts: Sequence[Piece]) -> bool:
        """Tell whether an object is furniture, most of which held up a plane look after look; retire it."""
        entry = self._objects[number]
        most = 2 * sum(len(part.rows) for part in parts) >= len(entry.points)
        entry.holding = entry.holding + 1 if most else 0
        if entry.holding >= SUPPORT_LOOKS:
            entry.retired = True
            self._index.note(entry)
        return entry.retired

    def _joins_refused(self, rows: Rows, owner: npt.NDArray[np.int32], asleep: UInt8Array) -> bool:
        """Tell whether a cluster of no one's is more of what was refused before, or of a large object."""
        if (owner > 0).any():
            return False
        return self._voxels.count_beside(rows, asleep) > REFUSED_SHARE * len(rows)

    def _give(self, cluster: MapCluster, pieces: dict[int, list[Piece]], wide: bool) -> None:
        owners = owners_of(cluster.rows, self._voxels, self._objects)
        if len(owners) > 1 and len(cluster.rows) > LARGE_VOXELS and not wide:
            held = self._voxels.owner[cluster.rows]
            for number in owners:
                pieces[number].append(Piece(number, cluster.rows[held == number], cluster.plane))
            return
        while len(owners) > 1:
            shares, touch = share_out(cluster, owners, self._voxels)
            pair = self._pair_to_merge(owners, touch)
            if pair is None:
                for number, rows in zip(owners, shares, strict=True):
                    pieces[number].append(Piece(number, rows, cluster.plane))
                return
            kept, gone = self._merge(*pair)
            self._voxels.pass_on(gone, kept)
            pieces[kept].extend(pieces.pop(gone, []))
            owners = [number for number in owners if number != gone]
        number = owners[0] if owners else 0
        pieces[number].append(Piece(number, cluster.rows, cluster.plane))

    def _pair_to_merge(self, owners: list[int], touch: Float64Array) -> tuple[int, int] | None:
        """Return two owners of a cluster that have proved to be one object, if any."""
        entries = [self._objects[number] for number in owners]
        packed = pack([entry.box for entry in entries])
        overlap = overlap_min_matrix(packed, packed)
        for i, a in enumerate(entries):
            for j in range(i + 1, len(entries)):
                b = entries[j]
                key = (min(a.number, b.number), max(a.number, b.number))
                verdict = self.bonds.verdict(*key)
                if verdict is False:
                    self._together.pop(key, None)
                    continue
                if touch[i, j] < CONTACT_SHARE and overlap[i, j] < MERGE_OVERLAP:
                    self._together.pop(key, None)
                    continue
                self._together[key] = self._together.get(key, 0) + 1
                sure = bool(verdict) or overlap[i, j] >= MERGE_OVERLAP or not (a.confirmed and b.confirmed)
                if self._together[key] >= (2 if sure else MERGE_LOOKS):
                    return key
        return None

    def _merge(self, first: int, second: int) -> tuple[int, int]:
        """Make two objects one: the older label stays, the younger is recorded. Returns (kept, gone)."""
        a, b = self._objects[first], self._objects[second]
        rank_a, rank_b = (a.label or np.inf, a.number), (b.label or np.inf, b.number)
        kept, gone = (a, b) if rank_a < rank_b else (b, a)
        kept.merged_labels = sorted({*kept.merged_labels, *gone.merged_labels, *([gone.label] if gone.label else [])})
        kept.first_frame = min(kept.first_frame, gone.first_frame)
        kept.last_frame = max(kept.last_frame, gone.last_frame)
        kept.frames_seen = max(kept.frames_seen, gone.frames_seen)
        kept.proposed = max(kept.proposed, gone.proposed)
        kept.whole = max(kept.whole, gone.whole)
        self._forget(gone)
        self.bonds.forget(gone.number)
        self.splits.forget(gone.number)
        self._together = {key: n for key, n in self._together.items() if gone.number not in key}
        return kept.number, gone.number

    def _update(self, entry: MapObject, pieces: list[Piece], frame: int) -> None:
        """Take an object's pieces: the largest and what hangs on it; parts that stand apart become objects."""
        pieces = sorted(pieces, key=lambda p: -len(p.rows))
        main = pieces[0]
        own, apart = [main.rows], []
        for piece in pieces[1:]:
            part, body = self._voxels.xyz(piece.rows), self._voxels.xyz(main.rows)
            reach = min(PART_REACH * float(entry.box.size.max()), PART_REACH_M)
            gap = gap_m(part, body, max(reach, FRAGMENT_GAP_M))
            small = len(piece.rows) < PART_SHARE * len(main.rows)
            hangs = entry.bonded and gap <= reach and (small or self._hangs(piece, part, body))
            if hangs or (small and gap <= TOUCH_M):
                own.append(piece.rows)
            elif gap > FRAGMENT_GAP_M:
                apart.append((piece, True))
            elif self._stands_apart(piece):
                apart.append((piece, False))
            else:
                own.append(piece.rows)
        near = [piece for piece, far in apart if not far]
        entry.apart = entry.apart + 1 if near else 0
        if entry.apart < SPLIT_LOOKS and entry.confirmed:
            own += [piece.rows for piece in near]
            near = []
        rows = np.sort(np.concatenate(own))
        if self._describe(entry, Piece(entry.number, rows, main.plane)):
            self._voxels.give(rows, entry.number)
        elif entry.confirmed:
            self._voxels.give(main.rows, entry.number)
        else:
            self._forget(entry)
            return
        for piece in near + [piece for piece, far in apart if far]:
            self._start(piece, frame)

    def _stands_apart(self, piece: Piece) -> bool:
        """Tell whether a piece is an object's size and has a foot of its own."""
        box = self._boxing.seen(piece)
        return is_object(box, self._config) and self._boxing.rests(piece, box)

    def _hangs(self, piece: Piece, part: Float32Array, body: Float32Array) -> bool:
        """Tell whether a piece has no foot of its own, or bends around the body as a far wall or a brim does."""
        box = self._boxing.seen(piece)
        return not self._boxing.rests(piece, box) or bends_around(part, body, box.up)[0]

    def _split(self, frame: int) -> None:
        """Make two of what has proved to be two things that touch; the larger one keeps the label."""
        proved = [self._objects[n] for n in sorted(self.splits.proved) if n in self._objects]
        side = self._voxels.side
        for entry in proved:
            if entry.retired:
                continue
            self.splits.forget(entry.number)
            rows = self._voxels.rows_of(entry.number)
            first = larger_side(self._voxels.xyz(rows), side[rows])
            if first is None:
                continue
            side[rows] = 0
            kept, other = (Piece(entry.number, rows[part], entry.plane) for part in (first, ~first))
            boxes = [self._boxing.seen(kept), self._boxing.seen(other)]
            common = float(overlap_min_matrix(pack(boxes[:1]), pack(boxes[1:]))[0, 0])
            # Two things that stand side by side share no more than the corners of their boxes.
            if common < APART_OVERLAP and all(is_object(box, self._config) for box in boxes):
                self._voxels.give(other.rows, 0)
                self._describe(entry, kept)
                self.bonds.sever(entry.number, self._next_number)
                self._start(other, frame)

    def _start(self, piece: Piece, frame: int) -> None:
        """Begin an object, or bring back a retired one that stood there."""
        box = self._boxing.seen(piece)
        if not is_object(box, self._config):
            return
        retired = [o for _, o in sorted(self._index.retired.items()) if o.holding < SUPPORT_LOOKS]
        if retired:
            common = overlap_min_matrix(pack([box]), pack([o.box for o in retired]))[0]
            if common.max() >= RETURN_OVERLAP:
                entry = retired[int(common.argmax())]
                entry.retired, entry.missing = False, 0
                self._describe(entry, piece)
                self._voxels.give(piece.rows, entry.number)
                return
        entry = MapObject(
            number=self._next_number,
            points=self._voxels.xyz(piece.rows),
            colors=self._voxels.rgb(piece.rows),
            box=box,
            plane=None,
            heat=0.0,
            mean_color=np.zeros(3),
            first_frame=frame,
            last_frame=frame,
            before=int(np.median(self._voxels.hits[piece.rows])) - 1,
        )
        self._next_number += 1
        self._objects[entry.number] = entry
        self._describe(entry, piece)
        self._voxels.give(piece.rows, entry.number)

    def _describe(self, entry: MapObject, piece: Piece) -> bool:
        """Fit the object to its voxels; False, and nothing changed, where they are not of an object's size."""
        box = self._boxing.seen(piece)
        if not is_object(box, self._config):
            return False
        entry.box = self._boxing.whole(piece, box, self._others(entry, box)) if entry.confirmed else box
        entry.plane = piece.plane
        entry.points, entry.colors = self._voxels.xyz(piece.rows), self._voxels.rgb(piece.rows)
        entry.heat = float(self._voxels.heat(piece.rows).mean())
        entry.mean_color = entry.colors.mean(0)
        entry.missing = 0
        self._index.note(entry)
        return True

    def _others(self, entry: MapObject, box: Box) -> list[MapObject]:
        """Return the labelled objects but this one that a box of it may have to do with, by label."""
        near = [self._objects[n] for n in self._index.near(box.center, NEAR_SIZES * float(np.linalg.norm(box.size)))]
        return sorted((o for o in near if o.confirmed and o is not entry), key=lambda o: o.label)

    def _forget(self, entry: MapObject) -> None:
        """Drop an object."""
        del self._objects[entry.number]
        self._weighed.discard(entry.number)
        self._index.drop(entry.number)

    def _age(self, missing: Iterable[MapObject]) -> None:
        """Retire what was not found at its place again and again; forget it where it never had a label."""
        for entry in missing:
            entry.missing += 1
            if not entry.confirmed:
                self._forget(entry)
            elif entry.missing >= RETIRE_LOOKS:
                entry.retired = True
                self._index.note(entry)

    def confirm(self) -> None:
        """Label what was proposed often enough and seen whole, in order of age."""
        for entry in [self._objects[n] for n in sorted(self._weighed) if n in self._objects]:
            if is_ready(entry):
                self._weighed.discard(entry.number)
                entry.label = self._next_label
                self._next_label += 1
                self._index.note(entry)

    def _may_be_early(self, entry: MapObject) -> bool:
        """Tell whether the frames before an object had a number may count, if nothing lies beside it."""
        return entry.before > 0 and times_alone(entry, self._boxing.plane(entry.plane)) == 1

    def _weigh(self, seen: Sequence[int]) -> None:
        """Tell how often each must be proposed before it gets a label; what is a part of something else joins that."""
        soon = self._config.confirm_frames - self._config.map_every
        waiting = [e for e in self._waiting(seen) if e.proposed >= soon or self._may_be_early(e)]
        # The largest first: what lies beside it may be its part.
        for entry in sorted(waiting, key=lambda e: -len(e.points)):
            other = beside(entry, [self._objects[n] for n in self._index.beside(entry.box, PART_REACH_M)])
            if other is not None and entry.proposed < soon:
                continue
            verdict = None if other is None else self.bonds.verdict(entry.number, other.number)
            if other is not None and is_part(
                entry, other, verdict, partial(self._boxing.stands, entry, self._others(entry, entry.box))
            ):
                kept, gone = self._merge(other.number, entry.number)
                self._voxels.pass_on(gone, kept)
                other.bonded = True
                continue
            times = patience(entry, other, verdict, self._boxing.plane(entry.plane))
            # What stands alone was itself before it had a number; beside others it may have been a part of them.
            before = entry.before if other is None and times == 1 else 0
            entry.patience = max(1, times * self._config.confirm_frames - before)
            self._weighed.add(entry.number)

    def _waiting(self, seen: Sequence[int]) -> list[MapObject]:
        """Return the objects without a label among and around those that were seen, in order of their numbers."""
        near = self._index.around(seen, AROUND_M)
        return [self._index.unlabelled[n] for n in near if n in self._index.unlabelled]
