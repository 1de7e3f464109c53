"""The tree of a place: surfaces, the objects on them, and the objects on and in those."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import Relation, SupportPlane, TrackedObject

# Kinds of relations that make an object a child of another one in the tree.
PLACED = ("on", "in")


@dataclass(frozen=True, slots=True)
class Branch:
    """A surface or an object of a place, with the objects on it and in it.

    Attributes
    ----------
    of : int or str
        Label of the object; "plane:k" for a supporting plane; "" for the parent of objects with an unknown support.
    kind : str
        Relation to the parent: "on" or "in"; "" at the root.
    score : float
        Probability of this relation, 0..1; 1 at the root.
    height_m : float or None
        Height of a surface above the lowest one, metres; None for an object.
    children : tuple of Branch
        By label.
    """

    of: int | str
    kind: str
    score: float
    height_m: float | None
    children: tuple[Branch, ...]


def place_tree(
    objects: Sequence[TrackedObject],
    relations: Mapping[int, Sequence[Relation]],
    planes: Sequence[SupportPlane],
    up: Float64Array | None,
) -> tuple[Branch, ...]:
    """Return the tree of a place: each object once, below its most likely support.

    Parameters
    ----------
    objects : sequence of TrackedObject
    relations : mapping of int to sequence of Relation
        By label, from `find_relations`.
    planes : sequence of SupportPlane
    up : (3,) float64 or None

    Returns
    -------
    tuple of Branch
        The surfaces that bear objects, the highest first; then, if there are any, the parent of the objects with an
        unknown support.
    """
    labels = {item.label for item in objects}
    above = {label: _support(relations.get(label, ()), labels) for label in sorted(labels)}
    _break_circles(above)
    below: dict[int | str, list[int]] = {}
    for label, support in above.items():
        below.setdefault("" if support is None else support.to, []).append(label)

    def grown(of: int | str, kind: str, score: float, height_m: float | None = None) -> Branch:
        children = []
        for label in below.get(of, ()):
            support = above[label]
            children.append(grown(label, *(("", 1.0) if support is None else (support.kind, support.score))))
        return Branch(of, kind, score, height_m, tuple(children))

    heights = plane_heights_m(planes, up)
    surfaces = [of for of in below if isinstance(of, str) and of]
    surfaces.sort(key=lambda of: (-heights[number_of(of)], number_of(of)))
    first = [grown(of, "", 1.0, heights[number_of(of)]) for of in surfaces]
    return (*first, *([grown("", "", 1.0)] if "" in below else []))


def plane_heights_m(planes: Sequence[SupportPlane], up: Float64Array | None) -> list[float]:
    """Return the height of the centre of each supporting plane above that of the lowest one, metres; up is (3,)."""
    if up is None:
        return [0.0] * len(planes)
    heights = [float(plane.extent.mean(0) @ up) for plane in planes]
    return [height - min(heights) for height in heights]


def number_of(surface: str) -> int:
    """Return the index in the name of a surface, "plane:k" or "wall:k"."""
    return int(surface.partition(":")[2])


def _support(relations: Sequence[Relation], labels: set[int]) -> Relation | None:
    """Return the most likely relation "on" or "in" of an object."""
    placed = [one for one in relations if one.kind in PLACED and (isinstance(one.to, str) or one.to in labels)]
    return max(placed, key=lambda one: one.score, default=None)


def _break_circles(above: dict[int, Relation | None]) -> None:
    """Make the least likely support unknown in each circle of objects that stand on each other."""
    for label in above:
        path: list[int] = []
        at: int | str | None = label
        while isinstance(at, int) and at not in path:
            path.append(at)
            support = above[at]
            at = None if support is None else support.to
        if isinstance(at, int):
            circle = path[path.index(at) :]
            weakest = min(circle, key=lambda one: _score(above[one]))
            above[weakest] = None


def _score(support: Relation | None) -> float:
    return 1.0 if support is None else support.score
