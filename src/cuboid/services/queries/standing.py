"""The surfaces of a place in words, and on or in what its objects are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import Relation, SupportPlane, tag_of
from cuboid.method.relations import surface_kinds
from cuboid.method.relations.tree import plane_heights_m
from cuboid.services.queries.sources import SupportingFurniture

_ARTICLES = {"floor": "the floor", "table": "a table", None: "a surface"}


def surface_words(
    planes: Sequence[SupportPlane], up: Float64Array | None, furniture: Mapping[int, SupportingFurniture]
) -> dict[str, str]:
    """Return the surfaces in words, by "plane:k": what each is, and its height above the lowest one."""
    heights_m, kinds = plane_heights_m(planes, up), surface_kinds(planes, up)
    found = {}
    for k, (height_m, kind) in enumerate(zip(heights_m, kinds, strict=True)):
        name = furniture[k].name if k in furniture else None
        words = _ARTICLES[kind] if name is None else f"the {name}"
        found[f"plane:{k}"] = words if kind == "floor" else f"{words}, {height_m:.2f} m high"
    return found


def standing_in_words(
    relations: Iterable[Relation], surfaces: Mapping[str, str], names: Mapping[int, str | None]
) -> str | None:
    """Return on or in what an object is, in words; None if it is not known.

    Parameters
    ----------
    relations : iterable of Relation
        Of the object.
    surfaces : mapping of str to str
        From `surface_words`.
    names : mapping of int to str or None
        Names of the objects, by label.
    """
    found = [
        f"{one.kind} {surfaces.get(one.to, one.to) if isinstance(one.to, str) else tag_of(one.to, names.get(one.to))}"
        for one in relations
        if one.kind in ("on", "in")
    ]
    return ", ".join(found) or None
