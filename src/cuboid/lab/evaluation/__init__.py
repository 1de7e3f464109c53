"""Evaluation of results (boxes of the map, identities over time, heat of points) against ground truth."""

from __future__ import annotations

from cuboid.lab.evaluation.evaluate import Evaluation, evaluate
from cuboid.lab.evaluation.evaluate_keyframes import KeyframeEvaluation, evaluate_keyframes
from cuboid.lab.evaluation.keyframes import Keyframes, read_keyframes
from cuboid.lab.evaluation.result import Result, read_result
from cuboid.lab.evaluation.truth import Truth, read_truth

__all__ = [
    "Evaluation",
    "KeyframeEvaluation",
    "Keyframes",
    "Result",
    "Truth",
    "evaluate",
    "evaluate_keyframes",
    "read_keyframes",
    "read_result",
    "read_truth",
]
