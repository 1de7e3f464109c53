"""Judges results: boxes of the map, identities over time, heat of points, against a truth or another's results."""

from __future__ import annotations

from cuboid.evaluation.evaluate import Evaluation, evaluate
from cuboid.evaluation.result import Result, read_result
from cuboid.evaluation.truth import Truth, read_truth

__all__ = ["Evaluation", "Result", "Truth", "evaluate", "read_result", "read_truth"]
