"""Evaluation of names that a detector gave to objects against the names in a truth.

People write "mug, white" where a detector says "cup". The kind of an object is the end of the first phrase of its true
name ("keyboard" in "keyboard, black (below the screen)"). It must be a class of the detector's vocabulary, directly or
through `SYNONYMS`; other objects are not judged.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cuboid.ground.core.results import TrackedObject
from cuboid.lab.evaluation.matching import ratio
from cuboid.results.files import Results

# Common words for classes of COCO.
SYNONYMS = {
    "monitor": "tv",
    "screen": "tv",
    "display": "tv",
    "television": "tv",
    "mug": "cup",
    "teacup": "cup",
    "coffee cup": "cup",
    "mobile phone": "cell phone",
    "smartphone": "cell phone",
    "sofa": "couch",
    "fridge": "refrigerator",
    "plant": "potted plant",
    "teddy": "teddy bear",
    "ball": "sports ball",
    "motorbike": "motorcycle",
    "plane": "airplane",
    "bike": "bicycle",
    "remote control": "remote",
}
# Text after one of these describes an object, but does not name its kind.
_REST = re.compile(r"[,:;(\"']|\b(?:with|on|of|at|near|behind|beside|before|in|for)\b")
# Number of best names among which the true class counts as found.
TOP_NAMES = 3


@dataclass(frozen=True, slots=True)
class NameOutcome:
    """The name of one object.

    Attributes
    ----------
    id : int
        Id of the object in the truth.
    name : str
        Name in the truth.
    true_class : str
        True class in the vocabulary.
    label : int
        Label of the object that was found.
    found_class : str or None
        Class of the found object; None if the detector gave none.
    in_top : bool
        Whether the true class is the name or one of the next two.
    """

    id: int
    name: str
    true_class: str
    label: int
    found_class: str | None
    in_top: bool


@dataclass(frozen=True, slots=True)
class Confusion:
    """Number of times that a true class was found as another class; None stands for no name."""

    true_class: str
    found_class: str | None
    count: int


@dataclass(frozen=True, slots=True)
class NameQuality:
    """Quality of the names.

    Attributes
    ----------
    judged : int
        Objects of the truth that were found and whose class the detector knows.
    named, right, in_top : int
        Judged objects with a name, with the true name, and with the true name among the first three.
    accuracy, top3, precision : float or None
        right / judged, in_top / judged, right / named.
    confusion : tuple of Confusion
        Confusions by true class, the most frequent first.
    objects : tuple of NameOutcome
    """

    judged: int
    named: int
    right: int
    in_top: int
    accuracy: float | None
    top3: float | None
    precision: float | None
    confusion: tuple[Confusion, ...]
    objects: tuple[NameOutcome, ...]


def class_of(name: str, vocabulary: Iterable[str]) -> str | None:
    """Return the class in a vocabulary of a name in a truth; None if there is none.

    >>> class_of("mug, white (far corner)", ["cup", "bowl"])
    'cup'
    >>> class_of("glass bowl with pens", ["cup", "bowl"])
    'bowl'
    >>> class_of("bowling pin", ["cup", "bowl"]) is None
    True
    """
    by_lower_case = {known.lower(): known for known in vocabulary}
    words = _REST.split(name.lower(), maxsplit=1)[0].split()
    for begin in range(len(words)):
        end = " ".join(words[begin:])
        for kind in (end, SYNONYMS.get(end, ""), end.removesuffix("s")):
            if kind in by_lower_case:
                return by_lower_case[kind]
    return None


def name_quality(results: Path | None, found: Sequence[tuple[int, str, int | None]]) -> NameQuality | None:
    """Evaluate the names of the objects that were found; None if no detector gave names.

    Parameters
    ----------
    results : Path or None
        Result folder, or None.
    found : sequence of (int, str, int or None)
        Id and name of each object of the truth, and the label that found it.
    """
    if results is None or not results.is_dir():
        return None
    run = Results(results)
    given = run.report.config.get("vocabulary")
    vocabulary = [name for name in given if isinstance(name, str)] if isinstance(given, list) else []
    if not vocabulary:
        return None
    outcomes = []
    for number, name, label in found:
        item = None if label is None else run.survivor.get(label)
        true_class = class_of(name, vocabulary)
        if item is not None and true_class is not None:
            outcomes.append(_outcome(number, name, true_class, item))
    return _quality(outcomes)


def _outcome(number: int, name: str, true_class: str, item: TrackedObject) -> NameOutcome:
    found_class = item.name if item.name_score is not None else None
    likely = [*([found_class] if found_class else []), *(name for name, _ in item.names)][:TOP_NAMES]
    return NameOutcome(number, name, true_class, item.label, found_class, true_class in likely)


def _quality(outcomes: Sequence[NameOutcome]) -> NameQuality:
    judged, named = len(outcomes), sum(outcome.found_class is not None for outcome in outcomes)
    right = sum(outcome.found_class == outcome.true_class for outcome in outcomes)
    in_top = sum(outcome.in_top for outcome in outcomes)
    pairs = Counter((outcome.true_class, outcome.found_class) for outcome in outcomes)
    order = sorted(pairs.items(), key=lambda pair: (pair[0][0], -pair[1], pair[0][1] or ""))
    return NameQuality(
        judged,
        named,
        right,
        in_top,
        ratio(right, judged),
        ratio(in_top, judged),
        ratio(right, named),
        tuple(Confusion(true, found, count) for (true, found), count in order),
        tuple(outcomes),
    )
