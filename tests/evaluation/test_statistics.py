from __future__ import annotations

import numpy as np
import pytest

from cuboid.lab.evaluation.statistics import compare, interval, intervals


def test_the_interval_of_a_mean_is_that_of_the_normal_theory_where_that_holds() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    found = interval(values)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert found.mean == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((found.mean - half, found.mean + half), abs=0.02)
    assert found == interval(values), "the same in every run"


def test_one_scene_and_missing_figures() -> None:
    rows = [{"hota": 0.5, "reid": None}, {"hota": 0.7}]
    found = intervals(rows, ["hota", "reid"])
    assert found["hota"].mean == pytest.approx(0.6)
    assert (found["hota"].low, found["hota"].high) == pytest.approx((0.5, 0.7))
    assert "reid" not in found
    assert interval([0.3]).low == interval([0.3]).high == 0.3


def test_pairs_tell_a_small_change_that_means_hide() -> None:
    rng = np.random.default_rng(2)
    easy = rng.uniform(0.2, 0.9, 30)
    before = {f"scene-{k}": {"hota": easy[k]} for k in range(30)}
    after = {f"scene-{k}": {"hota": easy[k] + 0.02 + rng.normal(0, 0.01)} for k in range(30)}
    after["other"] = {"hota": 0.0}
    found = compare(before, after, ["hota"])["hota"]
    assert found.sure
    assert found.difference.mean == pytest.approx(0.02, abs=0.005)
    assert found.before.high > found.after.low, "their own intervals overlap"
    assert (found.up + found.down, found.same) == (30, 0)
    same = compare(before, before, ["hota"])["hota"]
    assert (same.sure, same.same) == (False, 30)
