from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_keyframes import drawn, keyframes_document, square

from cuboid.lab.evaluation.keyframes import Keyframe, keyframes_from_json
from cuboid.lab.evaluation.rectangles import Outcome, judge_frame


def keyframe(boxes: list[dict[str, Any]], ignore: list[list[float]] | None = None) -> Keyframe:
    return keyframes_from_json(Path("made"), keyframes_document({0: boxes}, {0: ignore or []})).frames[0]


def judged(
    boxes: list[dict[str, Any]], found: list[list[float]], ignore: list[list[float]] | None = None, at: float = 0.5
) -> tuple[list[int], list[str]]:
    """Return the partner of each drawn rectangle and the outcome of each found one."""
    result = judge_frame(keyframe(boxes, ignore), np.array(found, np.float64).reshape(-1, 4), at)
    return result.partner.tolist(), [outcome.value for outcome in result.outcomes]


def test_what_reaches_the_iou_is_found_and_the_rest_is_false() -> None:
    boxes = [drawn(1, square(0)), drawn(2, square(100))]
    # Moved by a third of its side a square has the IoU (2/3) / (4/3) = 0.5 with itself; a little more, and less.
    assert judged(boxes, [square(10 / 3 - 1e-6), square(100 + 10 / 3 + 1e-3)]) == ([0, -1], ["true", "false"])
    assert judged(boxes, [square(104), square(103)], at=0.25) == ([-1, 1], ["false", "true"])
    assert judged([], [square(0)]) == ([], ["false"])
    assert judged(boxes, []) == ([-1, -1], [])


def test_more_pairs_go_before_a_larger_sum() -> None:
    # The first sighting fits the first thing with IoU 1, but only it fits the second; the other fits the first alone.
    boxes = [drawn(1, square(0)), drawn(2, square(2))]
    assert judged(boxes, [square(0), square(-2)]) == ([1, 0], ["true", "true"])
    # Two for one thing: the better one is its partner, the other is false.
    assert judged([drawn(1, square(0))], [square(1), square(0.5)]) == ([1], ["false", "true"])


def test_half_of_it_in_an_ignored_place_counts_neither_way() -> None:
    ignored = [square(200, side=20.0)]
    assert judged([], [[195, 0, 205, 10]], ignored)[1] == ["ignored"]
    assert judged([], [[194.9, 0, 205, 10]], ignored)[1] == ["false"]
    # Two ignored places hold a half together, but none does alone.
    assert judged([], [[0, 0, 10, 10]], [[0, 0, 10, 4], [0, 6, 10, 10]])[1] == ["false"]
    # A thing that is drawn in an ignored place must be found all the same.
    assert judged([drawn(1, square(205))], [square(205)], ignored) == ([0], ["true"])


def test_of_what_shows_too_little_neither_finding_nor_missing_counts() -> None:
    hardly, enough = drawn(1, square(0, side=20.0), visible=0.29), drawn(2, square(100), visible=0.3)
    result = judge_frame(keyframe([hardly, enough]), np.array([square(0, side=20.0), square(100)]), 0.5)
    assert list(result.outcomes) == [Outcome.HARDLY_VISIBLE, Outcome.TRUE]
    assert result.counts.tolist() == [False, True]
    assert result.found.tolist() == [False, True]
    assert judged([hardly], [square(5)])[1] == ["hardly visible"]  # a part of it
    assert judged([hardly], [square(-6)])[1] == ["false"]


def test_a_group_is_found_as_a_whole_and_its_things_are_not_false() -> None:
    pile = drawn(1, square(0, side=30.0), group=True)
    assert judged([pile], [square(1, side=29.0)]) == ([0], ["true"])
    assert judged([pile], [square(0), square(12), square(40)]) == ([-1], ["in group", "in group", "false"])
    single = drawn(1, square(0, side=30.0))
    assert judged([single], [square(0), square(12)]) == ([-1], ["false", "false"])


def test_a_group_among_the_objects_is_one_in_every_frame() -> None:
    document = keyframes_document({0: [drawn(1, square(0, side=30.0))]})
    document["objects"][0]["group"] = True
    frame = keyframes_from_json(Path("made"), document).frames[0]
    assert judge_frame(frame, np.array([square(5.0)]), 0.5).outcomes == (Outcome.IN_GROUP,)


corner = st.integers(0, 12)
rect = st.tuples(corner, corner, st.integers(2, 8), st.integers(2, 8)).map(
    lambda r: [float(r[0]), float(r[1]), float(r[0] + r[2]), float(r[1] + r[3])]
)


@given(st.lists(rect, max_size=4), st.lists(rect, max_size=4), st.sampled_from((0.25, 0.5)))
def test_the_pairing_is_the_best_of_all(things: list[list[float]], found: list[list[float]], least: float) -> None:
    result = judge_frame(
        keyframe([drawn(i + 1, r) for i, r in enumerate(things)]), np.array(found).reshape(-1, 4), least
    )
    pairs = [(i, int(k)) for i, k in enumerate(result.partner) if k >= 0]
    assert len({k for _, k in pairs}) == len(pairs)

    def worth(chosen: list[tuple[int, int]]) -> tuple[int, float]:
        return len(chosen), sum(overlap(things[i], found[k]) for i, k in chosen)

    best = (0, 0.0)
    slots = [*range(len(found)), *[-1] * len(things)]
    for order in set(permutations(slots, len(things))):
        best = max(
            best, worth([(i, k) for i, k in enumerate(order) if k >= 0 and overlap(things[i], found[k]) >= least])
        )
    assert worth(pairs)[0] == best[0]
    assert worth(pairs)[1] == pytest.approx(best[1])


def overlap(a: list[float], b: list[float]) -> float:
    """IoU of rectangles at whole pixels, by counting pixels."""
    pixels = [{(x, y) for x in range(int(r[0]), int(r[2])) for y in range(int(r[1]), int(r[3]))} for r in (a, b)]
    return len(pixels[0] & pixels[1]) / len(pixels[0] | pixels[1])
