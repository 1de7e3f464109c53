"""Anchors of the map's points: keyframes, whose pose corrections are applied to the points lazily.

A correction moves keyframes, but no points. Each point stores its anchor: a keyframe with one of its poses. When a
keyframe moves, its motion becomes pending for all points of its anchor; points that are seen from it later get a new
anchor without a pending motion. Each anchor lists the cubes that contain its points, so that points with a pending
motion are found without a search in other cubes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.state import Record
from cuboid.method.heatmap.kernels.cubes import ANCHORS

# Largest keyframe number that is distinguished: hours of video. Up to it, a keyframe's first anchor has the keyframe's
# number; higher numbers are anchors of keyframes that have moved since some of their points were placed.
LAST_KEYFRAME = ANCHORS // 2 - 1

Numbers = npt.NDArray[np.int64]
CubeNumbers = npt.NDArray[np.int32]


@dataclass(slots=True, eq=False)
class Anchor(Record):
    """A keyframe with one of its poses; values of attributes are replaced, never changed in place.

    Attributes
    ----------
    number : int
    keyframe : int
    cubes : (N,) int32
        Cubes that may contain its points, ascending.
    T_new_old : (4, 4) float64 or None
        Pending motion of its points in the world; None if there is none.
    """

    number: int
    keyframe: int
    cubes: CubeNumbers = field(default_factory=lambda: np.zeros(0, np.int32))
    T_new_old: Float64Array | None = None


@dataclass(frozen=True, slots=True)
class AnchorsState(Record):
    """State of `Anchors`.

    Attributes
    ----------
    all : dict of int to Anchor
        The anchors by number.
    now : dict of int to int
        Current anchor of each keyframe, by the number of the keyframe.
    last_number : int
        Number of the last anchor that a moved keyframe got.
    """

    all: dict[int, Anchor]
    now: dict[int, int]
    last_number: int


class Anchors:
    """All anchors of a map.

    Attributes
    ----------
    pending : (ANCHORS,) bool
        Whether a motion of each anchor's points is pending.
    motions : (ANCHORS, 3, 4) float64
        The pending motions.
    """

    NOT_SAVED = frozenset({"pending", "motions", "_keyframes", "_of_keyframe", "_pairs"})

    def __init__(self) -> None:
        self._all: dict[int, Anchor] = {}
        # Anchor of new points from each keyframe.
        self._now: dict[int, int] = {}
        self._last_number = LAST_KEYFRAME
        self.pending: npt.NDArray[np.bool_] = np.zeros(ANCHORS, bool)
        self.motions: Float64Array = np.zeros((ANCHORS, 3, 4))
        self._keyframes: npt.NDArray[np.uint16] = np.arange(ANCHORS, dtype=np.uint16)
        # Numbers of the anchors of each keyframe.
        self._of_keyframe: dict[int, set[int]] = {}
        self._pairs: tuple[CubeNumbers, CubeNumbers] | None = None

    def state(self) -> AnchorsState:
        """Return the current state; it shares the anchors, so copy their attributes before the next update."""
        return AnchorsState(dict(self._all), dict(self._now), self._last_number)

    @classmethod
    def from_state(cls, state: AnchorsState) -> Anchors:
        """Return the anchors of a state."""
        anchors = cls()
        anchors._all, anchors._now, anchors._last_number = state.all, state.now, state.last_number
        anchors._remake()
        return anchors

    def _remake(self) -> None:
        """Recompute the tables that follow from the anchors."""
        self.pending[:], self._keyframes[:], self._of_keyframe, self._pairs = False, np.arange(ANCHORS), {}, None
        for anchor in self._all.values():
            self._register(anchor)

    def _register(self, anchor: Anchor) -> None:
        self._of_keyframe.setdefault(anchor.keyframe, set()).add(anchor.number)
        self._keyframes[anchor.number] = anchor.keyframe
        self.pending[anchor.number] = anchor.T_new_old is not None
        if anchor.T_new_old is not None:
            self.motions[anchor.number] = anchor.T_new_old[:3]
            self._pairs = None

    @property
    def cubes(self) -> int:
        """One more than the highest number of a cube that may contain points."""
        return max((int(anchor.cubes.max(initial=-1)) + 1 for anchor in self._all.values()), default=0)

    def keyframes(self, anchors: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint16]:
        """Return the keyframes of anchors (N,)."""
        return self._keyframes[anchors]

    def current_anchor(self, keyframe: int) -> int:
        """Return the anchor for new points from a keyframe; no motion is pending for it."""
        number = self._now.get(keyframe)
        if number is None:
            number = keyframe if keyframe not in self._all else self._free()
            self._now[keyframe] = number
            self._all[number] = Anchor(number, keyframe)
            self._register(self._all[number])
        return number

    def _free(self) -> int:
        while True:
            self._last_number = self._last_number + 1 if self._last_number < ANCHORS - 1 else LAST_KEYFRAME + 1
            if self._last_number not in self._all:
                return self._last_number

    @property
    def crowded(self) -> bool:
        """Whether anchor numbers may run out if all keyframes move and are used again."""
        others = sum(number > LAST_KEYFRAME for number in self._all)
        return others + len(self._of_keyframe) > ANCHORS - 1 - LAST_KEYFRAME

    def has_points_in(self, number: int, cubes: Numbers) -> None:
        """Record that cubes, each listed once, contain points of an anchor."""
        anchor = self._all[number]
        # The known cubes are sorted; `np.isin` would sort them again.
        new = cubes[np.searchsorted(anchor.cubes, cubes, "left") == np.searchsorted(anchor.cubes, cubes, "right")]
        if len(new):
            anchor.cubes = np.sort(np.concatenate([anchor.cubes, new.astype(np.int32)]))

    def add_pending(self, moved: Mapping[int, Float64Array]) -> CubeNumbers:
        """Add motions (T_new_old) to the pending ones of keyframes; return the cubes that may contain their points."""
        cubes = [np.zeros(0, np.int32)]
        for keyframe, T_new_old in moved.items():
            for number in sorted(self._of_keyframe.get(keyframe, ())):
                anchor = self._all[number]
                if len(anchor.cubes):
                    anchor.T_new_old = T_new_old if anchor.T_new_old is None else T_new_old @ anchor.T_new_old
                    cubes.append(anchor.cubes)
                    self._register(anchor)
                    if self._now.get(keyframe) == number:
                        del self._now[keyframe]
        return np.concatenate(cubes)

    @property
    def pending_cubes(self) -> tuple[CubeNumbers, CubeNumbers]:
        """Cubes with points whose motion is pending, (N,), and the anchor of each such pair, (N,)."""
        if self._pairs is None:
            moved = [anchor for anchor in self._all.values() if anchor.T_new_old is not None]
            cubes = np.concatenate([np.zeros(0, np.int32), *(anchor.cubes for anchor in moved)])
            numbers = np.array([anchor.number for anchor in moved], np.int32)
            self._pairs = cubes, np.repeat(numbers, [len(anchor.cubes) for anchor in moved])
        return self._pairs

    def clear_pending(self, cubes: Numbers) -> None:
        """Record that no motion is pending in some cubes any more."""
        pending_cubes, pending_numbers = self.pending_cubes
        cleared = np.isin(pending_cubes, cubes)
        touched = np.unique(pending_numbers[cleared]).tolist()
        self._pairs = pending_cubes[~cleared], pending_numbers[~cleared]
        for number in touched:
            anchor = self._all[number]
            anchor.cubes = anchor.cubes[~np.isin(anchor.cubes, cubes)]
            if not len(anchor.cubes):
                self._forget(anchor)

    def _forget(self, anchor: Anchor) -> None:
        del self._all[anchor.number]
        self._of_keyframe[anchor.keyframe].discard(anchor.number)
        self.pending[anchor.number], self._keyframes[anchor.number] = False, anchor.number

    def anchors_after_motion(self, anchors: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint16]:
        """Return for each anchor (ANCHORS,) the anchor of its points after pending motions of `anchors` (N,)."""
        current = np.arange(ANCHORS, dtype=np.uint16)
        used = np.flatnonzero(np.bincount(anchors, minlength=1))
        for number in used[self.pending[used]].tolist():
            current[number] = self.current_anchor(self._all[number].keyframe)
        return current

    def begin_anew(self, anchors: npt.NDArray[np.uint16], cubes: Numbers) -> None:
        """Replace all points by these, with anchors (N,) and cubes (N,); unknown anchors have no pending motion."""
        for anchor in self._all.values():
            anchor.cubes = np.zeros(0, np.int32)
        for number, cubes_of_anchor in of_each(anchors, cubes):
            if number not in self._all:
                self._all[number] = Anchor(number, number)
                self._now.setdefault(number, number)
            self._all[number].cubes = cubes_of_anchor.astype(np.int32)
        self._all = {number: anchor for number, anchor in self._all.items() if len(anchor.cubes)}
        self._now = {keyframe: number for keyframe, number in self._now.items() if number in self._all}
        self._remake()


def of_each(anchors: npt.NDArray[np.uint16], cubes: Numbers) -> Iterator[tuple[int, Numbers]]:
    """Yield each anchor of points (N,), ascending, and the cubes (M,) that contain its points, ascending."""
    pairs = (anchors.astype(np.int64) << 32) | cubes
    pairs = np.unique(pairs[np.flatnonzero(np.diff(pairs, prepend=-1))])  # drop repeated pairs before sorting
    numbers, firsts = np.unique(pairs >> 32, return_index=True)
    yield from zip(numbers.tolist(), np.split(pairs & 0xFFFFFFFF, firsts[1:])[: len(numbers)], strict=True)
