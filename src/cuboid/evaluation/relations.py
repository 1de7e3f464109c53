"""Relations between objects, against those of a truth, kind by kind.

A found object is that of the truth which the map's quality pairs it with. Relations of objects that were not found are
counted apart: the geometry of what is not there cannot be judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.core.frame import Float64Array
from cuboid.core.results import RELATIONS, Relation, SupportPlane
from cuboid.core.tolerances import DRIFT_M
from cuboid.core.values import RelationKind
from cuboid.evaluation.matching import ratio
from cuboid.evaluation.truth import Truth, TruthObject, TruthRelation
from cuboid.relations import Wall

# A found surface is one of the truth where the two are no farther apart than this at the object, metres, and their
# normals differ by no more than this, as a cosine.
SAME_SURFACE_M, SAME_NORMAL = 2.0 * DRIFT_M, 0.97

Key = tuple[int, RelationKind, int | str]


@dataclass(frozen=True, slots=True)
class RelationsAt:
    """How right the relations of one kind are.

    Attributes
    ----------
    kind : str
    true : int
        Relations of the truth between objects that were found.
    found, right : int
        Found relations between objects of the truth, and those of them that hold.
    lost : int
        Relations of the truth of an object that was not found.
    precision, recall : float or None
        right / found, right / true; None where nothing is judged.
    """

    kind: RelationKind
    true: int
    found: int
    right: int
    lost: int
    precision: float | None
    recall: float | None


def relation_quality(
    truth: Truth,
    found: Mapping[int, Sequence[Relation]],
    label_of: Mapping[int, int],
    planes: Sequence[SupportPlane],
    walls: Sequence[Wall],
    T_truth_result: Float64Array,
) -> tuple[RelationsAt, ...]:
    """Judge relations.

    Parameters
    ----------
    truth : Truth
        With relations.
    found : mapping of int to sequence of Relation
        By label.
    label_of : mapping of int to int
        The label that each judged object of the truth was found as, by its id.
    planes : sequence of SupportPlane
    walls : sequence of Wall
        Of the result.
    T_truth_result : (4, 4) float64
    """
    id_of = {label: number for number, label in label_of.items()}
    body = {item.id: item for item in truth.objects}
    surfaces = _Surfaces(truth, planes, walls, T_truth_result)
    true: set[Key] = set()
    open_ones: set[Key] = set()
    lost = dict.fromkeys(RELATIONS, 0)
    for one in truth.relations or ():
        ends = [end for end in (one.subject, one.to) if isinstance(end, int)]
        if not one.judged or not all(end in label_of for end in ends):
            lost[one.kind] += one.judged and all(body[end].judged for end in ends)
        key = surfaces.key_of(one)
        (true if one.judged and all(end in label_of for end in ends) else open_ones).add(key)
    got = {
        (id_of[label], one.kind, to)
        for label, relations in found.items()
        if label in id_of
        for one in relations
        for to in [surfaces.end_of(one, body[id_of[label]], id_of)]
        if to is not None
    } - open_ones
    return tuple(_at(kind, true, got, lost[kind]) for kind in RELATIONS)


def _at(kind: RelationKind, true: set[Key], got: set[Key], lost: int) -> RelationsAt:
    own, said = ({one for one in keys if one[1] == kind} for keys in (true, got))
    right = len(own & said)
    return RelationsAt(kind, len(own), len(said), right, lost, ratio(right, len(said)), ratio(right, len(own)))


class _Surfaces:
    """The surfaces of a truth and of a result; those of one height are one."""

    def __init__(
        self, truth: Truth, planes: Sequence[SupportPlane], walls: Sequence[Wall], T_truth_result: Float64Array
    ) -> None:
        self._true = {"plane": truth.planes, "wall": truth.walls}
        R, t = T_truth_result[:3, :3], T_truth_result[:3, 3]
        self._found = {
            what: [(R @ one.normal, one.offset - float(R @ one.normal @ t)) for one in those]
            for what, those in (("plane", planes), ("wall", walls))
        }

    def key_of(self, relation: TruthRelation) -> Key:
        """Return a relation of the truth, with the first of the surfaces that are the same plane."""
        to = relation.to
        if isinstance(to, str):
            what, _, number = to.partition(":")
            normal, offset = self._true[what][int(number)]
            same = (
                k for k, (n, d) in enumerate(self._true[what]) if n @ normal > SAME_NORMAL and abs(d - offset) < 1e-3
            )
            to = f"{what}:{next(same)}"
        return relation.subject, relation.kind, to

    def end_of(self, relation: Relation, item: TruthObject, id_of: Mapping[int, int]) -> int | str | None:
        """Return what a found relation is to, in the truth; None where the truth does not speak of it."""
        if isinstance(relation.to, int):
            return id_of.get(relation.to)
        what, _, number = relation.to.partition(":")
        normal, offset = self._found[what][int(number)]
        place = item.box.center
        away = [
            abs(float(normal @ place) + offset - float(n @ place) - d) if n @ normal > SAME_NORMAL else np.inf
            for n, d in self._true[what]
        ]
        if not away or min(away) > SAME_SURFACE_M:
            # The truth names the surfaces that bear things, and the walls: it does not name what is below others.
            return None if relation.kind == "under" else f"another {what}"
        return f"{what}:{int(np.argmin(away))}"
