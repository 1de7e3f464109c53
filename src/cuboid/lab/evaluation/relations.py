"""Evaluation of relations between objects against ground truth, for each kind of relation.

Found objects are matched to true ones as for the quality of the map. Relations of objects that were not found are
counted separately: the geometry of a missing object cannot be judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import RELATIONS, Relation, SupportPlane
from cuboid.ground.core.tolerances import DRIFT_M
from cuboid.ground.core.values import RelationKind
from cuboid.ground.formats.relations import RelationOfTruth
from cuboid.lab.evaluation.matching import ratio
from cuboid.lab.evaluation.truth import Truth, TruthObject
from cuboid.method.relations import Wall

# A found surface matches a true one if their distance at the object is at most SAME_SURFACE_M, metres, and the cosine
# between their normals is at least SAME_NORMAL.
SAME_SURFACE_M, SAME_NORMAL = 2.0 * DRIFT_M, 0.97

Key = tuple[int, RelationKind, int | str]


@dataclass(frozen=True, slots=True)
class RelationsAt:
    """Quality of the relations of one kind.

    Attributes
    ----------
    kind : str
    true : int
        Relations of the truth between objects that were found.
    found, right : int
        Found relations between objects of the truth, and correct ones among them.
    lost : int
        Relations of the truth of an object that was not found.
    precision, recall : float or None
        right / found, right / true; None if nothing is judged.
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
    """Evaluate relations against ground truth.

    Parameters
    ----------
    truth : Truth
        A truth with relations.
    found : mapping of int to sequence of Relation
        Relations by label.
    label_of : mapping of int to int
        Label of each judged object of the truth that was found, by the object's id.
    planes : sequence of SupportPlane
    walls : sequence of Wall
        Walls of the result.
    T_truth_result : (4, 4) float64
    """
    id_of = {label: number for number, label in label_of.items()}
    body = {item.id: item for item in truth.objects}
    surfaces = _Surfaces(truth, planes, walls, T_truth_result)
    true: set[Key] = set()
    undecided: set[Key] = set()
    lost = dict.fromkeys(RELATIONS, 0)
    for relation in truth.relations or ():
        ends = [end for end in (relation.subject, relation.to) if isinstance(end, int)]
        decided = relation.judged and all(end in label_of for end in ends)
        if not decided:
            lost[relation.kind] += relation.judged and all(body[end].judged for end in ends)
        (true if decided else undecided).add(surfaces.key_of(relation))
    found_keys = {
        (id_of[label], relation.kind, to)
        for label, relations in found.items()
        if label in id_of
        for relation in relations
        for to in [surfaces.end_of(relation, body[id_of[label]], id_of)]
        if to is not None
    } - undecided
    return tuple(_at(kind, true, found_keys, lost[kind]) for kind in RELATIONS)


def _at(kind: RelationKind, true: set[Key], found: set[Key], lost: int) -> RelationsAt:
    true_of_kind, found_of_kind = ({key for key in keys if key[1] == kind} for keys in (true, found))
    right = len(true_of_kind & found_of_kind)
    return RelationsAt(
        kind,
        len(true_of_kind),
        len(found_of_kind),
        right,
        lost,
        ratio(right, len(found_of_kind)),
        ratio(right, len(true_of_kind)),
    )


class _Surfaces:
    """The surfaces of a truth and of a result; surfaces in the same plane are one."""

    def __init__(
        self, truth: Truth, planes: Sequence[SupportPlane], walls: Sequence[Wall], T_truth_result: Float64Array
    ) -> None:
        self._true = {"plane": truth.planes, "wall": truth.walls}
        R, t = T_truth_result[:3, :3], T_truth_result[:3, 3]
        self._found = {
            kind: [(R @ surface.normal, surface.offset - float(R @ surface.normal @ t)) for surface in surfaces]
            for kind, surfaces in (("plane", planes), ("wall", walls))
        }

    def key_of(self, relation: RelationOfTruth) -> Key:
        """Return the key of a true relation, with the first of the surfaces in the same plane."""
        to = relation.to
        if isinstance(to, str):
            kind, _, number = to.partition(":")
            normal, offset = self._true[kind][int(number)]
            same = (
                k for k, (n, d) in enumerate(self._true[kind]) if n @ normal > SAME_NORMAL and abs(d - offset) < 1e-3
            )
            to = f"{kind}:{next(same)}"
        return relation.subject, relation.kind, to

    def end_of(self, relation: Relation, item: TruthObject, id_of: Mapping[int, int]) -> int | str | None:
        """Return the target, in the truth, of a found relation; None if the truth does not cover it."""
        if isinstance(relation.to, int):
            return id_of.get(relation.to)
        kind, _, number = relation.to.partition(":")
        normal, offset = self._found[kind][int(number)]
        place = item.box.center
        away = [
            abs(float(normal @ place) + offset - float(n @ place) - d) if n @ normal > SAME_NORMAL else np.inf
            for n, d in self._true[kind]
        ]
        if not away or min(away) > SAME_SURFACE_M:
            # The truth lists the supporting surfaces and the walls; it lists no surfaces that are below others.
            return None if relation.kind == "under" else f"another {kind}"
        return f"{kind}:{int(np.argmin(away))}"
