"""The map of objects: grown from the map's clusters, matched by each frame's boxes, labelled for life."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from cuboid.boxes.fit import fit_box
from cuboid.config import TrackerConfig
from cuboid.geometry.overlap import overlap_min_matrix, pack
from cuboid.heatmap.voxel_map import Rows, VoxelMap
from cuboid.objects.entry import MapObject
from cuboid.objects.ownership import CONTACT_SHARE, Piece, contact, gap_m, owners_of, share_out
from cuboid.objects.validity import is_object, rests
from cuboid.surfaces.clusters import MapCluster
from cuboid.surfaces.planes import PlaneTracker

# Two labelled objects that touch as one in so many looks at the map are one.
MERGE_LOOKS = 6
# ... at once when this share of the smaller one's box lies in the other's: drift made two of one.
MERGE_OVERLAP = 0.5
# A part that stands apart in so many looks is an object of its own.
SPLIT_LOOKS = 8
# A part farther from its object than this, metres, is no part of it.
FRAGMENT_GAP_M = 0.04
# An object that was not found in so many looks at its place is retired.
RETIRE_LOOKS = 5
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
        self._together: dict[tuple[int, int], int] = {}
        self._next_number = 1
        self._next_label = 1

    def alive(self) -> list[MapObject]:
        """Return all objects that are not retired, confirmed or not, in order of their numbers."""
        return [o for o in self._objects.values() if not o.retired]

    def confirmed(self) -> list[MapObject]:
        """Return the objects of the map that have a label, by label."""
        return sorted((o for o in self.alive() if o.confirmed), key=lambda o: o.label)

    def settle(self, frame: int, clusters: Sequence[MapCluster]) -> None:
        """Bring the objects up to date with the map's clusters."""
        pieces = self._divide(clusters)
        before = np.flatnonzero(self._voxels.owner[: self._voxels.count] > 0)
        self._voxels.owner[before] = 0
        for number, own in pieces.items():
            if number:
                self._update(self._objects[number], own, frame)
        for piece in pieces.get(0, []):
            self._start(piece, frame)
        self._age(pieces.keys())
        self._confirm()

    def _divide(self, clusters: Sequence[MapCluster]) -> dict[int, list[Piece]]:
        """Give each cluster to its owner; share contested ones out unless their owners turn out to be one."""
        pieces: dict[int, list[Piece]] = defaultdict(list)
        for cluster in clusters:
            owners = owners_of(cluster.rows, self._voxels, self._objects)
            while len(owners) > 1:
                shares = share_out(cluster.rows, owners, self._voxels)
                pair = self._pair_to_merge(owners, shares)
                if pair is None:
                    for number, rows in zip(owners, shares, strict=True):
                        pieces[number].append(Piece(number, rows, cluster.plane))
                    break
                kept, gone = self._merge(*pair)
                self._voxels.owner[self._voxels.owner == gone] = kept
                for piece in pieces.pop(gone, []):
                    pieces[kept].append(piece)
                owners = [number for number in owners if number != gone]
            else:
                number = owners[0] if owners else 0
                pieces[number].append(Piece(number, cluster.rows, cluster.plane))
        return pieces

    def _pair_to_merge(self, owners: list[int], shares: list[Rows]) -> tuple[int, int] | None:
        for i in range(len(owners)):
            for j in range(i + 1, len(owners)):
                a, b = self._objects[owners[i]], self._objects[owners[j]]
                key = (min(owners[i], owners[j]), max(owners[i], owners[j]))
                if len(shares[i]) == 0 or len(shares[j]) == 0:
                    return key
                overlap = overlap_min_matrix(pack([a.box]), pack([b.box]))[0, 0]
                touch = contact(self._voxels.xyz(shares[i]), self._voxels.xyz(shares[j]), self._voxels.voxel_m)
                if touch >= CONTACT_SHARE or overlap >= MERGE_OVERLAP:
                    self._together[key] = self._together.get(key, 0) + 1
                else:
                    self._together.pop(key, None)
                sure = overlap >= MERGE_OVERLAP or not (a.confirmed and b.confirmed)
                if self._together.get(key, 0) >= (2 if sure else MERGE_LOOKS):
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
        del self._objects[gone.number]
        self._together = {key: n for key, n in self._together.items() if gone.number not in key}
        return kept.number, gone.number

    def _update(self, entry: MapObject, pieces: list[Piece], frame: int) -> None:
        """Take an object's pieces: the largest and what hangs on it; parts that stand apart become objects."""
        pieces = sorted(pieces, key=lambda p: -len(p.rows))
        main = pieces[0]
        own, apart = [main.rows], []
        for piece in pieces[1:]:
            if gap_m(self._voxels.xyz(piece.rows), self._voxels.xyz(main.rows)) > FRAGMENT_GAP_M:
                apart.append((piece, True))
            elif is_object(self._box(piece), self._config) and rests(self._box(piece), self._plane(piece)):
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
            self._voxels.owner[rows] = entry.number
        elif entry.confirmed:
            self._voxels.owner[main.rows] = entry.number
        else:
            del self._objects[entry.number]
            return
        for piece in near + [piece for piece, far in apart if far]:
            self._start(piece, frame)

    def _start(self, piece: Piece, frame: int) -> None:
        """Begin an object, or bring back a retired one that stood there."""
        box = self._box(piece)
        if not is_object(box, self._config):
            return
        retired = [o for o in self._objects.values() if o.retired]
        if retired:
            common = overlap_min_matrix(pack([box]), pack([o.box for o in retired]))[0]
            if common.max() >= RETURN_OVERLAP:
                entry = retired[int(common.argmax())]
                entry.retired, entry.missing = False, 0
                self._describe(entry, piece)
                self._voxels.owner[piece.rows] = entry.number
                return
        entry = MapObject(
            number=self._next_number,
            rows=piece.rows,
            points=self._voxels.xyz(piece.rows),
            box=box,
            plane=None,
            heat=0.0,
            mean_color=np.zeros(3),
            first_frame=frame,
            last_frame=frame,
        )
        self._next_number += 1
        self._objects[entry.number] = entry
        self._describe(entry, piece)
        self._voxels.owner[piece.rows] = entry.number

    def _describe(self, entry: MapObject, piece: Piece) -> bool:
        """Fit the object to its voxels; False, and nothing changed, where they are not of an object's size."""
        box = self._box(piece)
        if not is_object(box, self._config):
            return False
        entry.rows, entry.box = piece.rows, box
        entry.plane = self._planes.planes[piece.plane] if piece.plane >= 0 else None
        entry.points = self._voxels.xyz(piece.rows)
        entry.heat = float(self._voxels.heat(piece.rows).mean())
        entry.mean_color = self._voxels.rgb(piece.rows).mean(0)
        entry.missing = 0
        return True

    def _plane(self, piece: Piece):  # type: ignore[no-untyped-def]
        return self._planes.plane_in_world(piece.plane) if piece.plane >= 0 else None

    def _box(self, piece: Piece):  # type: ignore[no-untyped-def]
        rows = piece.rows
        hits = self._voxels.hits[rows]
        solid = rows[hits >= min(3.0, 0.1 * float(np.median(hits)))]
        plane = self._plane(piece)
        if plane is not None:
            return fit_box(self._voxels.xyz(solid), *plane)
        up = self._planes.up
        return fit_box(self._voxels.xyz(solid), up if up is not None else np.array([0.0, -1.0, 0.0]), None)

    def _age(self, found: Iterable[int]) -> None:
        """Retire what was not found at its place again and again; forget it where it never had a label."""
        present = set(found)
        for entry in self.alive():
            if entry.number in present:
                continue
            entry.missing += 1
            if not entry.confirmed and entry.missing >= 2:
                self._objects.pop(entry.number, None)
            elif entry.missing >= RETIRE_LOOKS:
                entry.retired = True

    def _confirm(self) -> None:
        for entry in self.alive():
            if entry.confirmed or entry.proposed < self._config.confirm_frames:
                continue
            plane = None
            if entry.plane is not None:
                plane = self._planes.plane_in_world(self._planes.planes.index(entry.plane))
            if rests(entry.box, plane):
                entry.label = self._next_label
                self._next_label += 1
