"""However much a source proposes, or a frame falls apart into: a frame takes its time and no more, and says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.limits import MAX_CANDIDATES, MAX_PROPOSALS, MAX_SEGMENTS
from cuboid.method.proposals.types import Proposals
from cuboid.method.surfaces.frame_segments import MIN_PIXELS, _drop_excess
from cuboid.results.files import read_run
from cuboid.runs.pipeline.options import TrackOptions
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from fakes import FakeRecording

WIDTH, HEIGHT = 640, 480
CAMERA = Intrinsics(540.0, 540.0, 319.5, 239.5, WIDTH, HEIGHT)


def blocks(index: int, side: int) -> Frame:
    """Return a frame in which every block of so many pixels is a thing of its own, elsewhere in each frame."""
    rng = np.random.default_rng(index)
    cells = rng.uniform(0.8, 1.6, (HEIGHT // side + 1, WIDTH // side + 1))
    depth = cells[np.ix_(np.arange(HEIGHT) // side, np.arange(WIDTH) // side)].astype(np.float32)
    color = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    return Frame(index, index / 30, color, depth, np.eye(4))


def tiles(side: int) -> Proposals:
    """Return a mask for each block, the better the later."""
    boxes = [
        (x, y, x + side, y + side) for y in range(0, HEIGHT - side + 1, side) for x in range(0, WIDTH - side + 1, side)
    ]
    scores = np.linspace(0.3, 1.0, len(boxes), dtype=np.float32)
    return Proposals(np.array(boxes, np.int32), scores, tuple(np.ones((side, side), np.uint8) for _ in boxes))


def large(count: int) -> Proposals:
    """Return boxes, each of which holds many blocks."""
    rng = np.random.default_rng(0)
    low = rng.integers(0, (WIDTH - 300, HEIGHT - 300), (count, 2))
    high = low + rng.integers(60, 300, (count, 2))
    return Proposals(np.hstack([low, high]).astype(np.int32), rng.random(count).astype(np.float32))


@pytest.mark.parametrize("made", [tiles(16), tiles(24), large(2000)], ids=["1200 masks", "520 masks", "2000 boxes"])
def test_a_frame_brings_no_more_than_its_limits(made: Proposals) -> None:
    tracker, left_out = PosedTracker(CAMERA, proposals=lambda frame, camera: made), {}
    for k in range(14):
        result = tracker.update(blocks(k, 24))
        assert len(result.proposals) <= MAX_SEGMENTS
        left_out = {what: left_out.get(what, 0) + count for what, count in result.left_out.items()}
        candidates = [o for o in tracker._map.store.living() if not o.confirmed]
        assert len(candidates) <= MAX_CANDIDATES + MAX_SEGMENTS
    assert left_out["proposals"] == 14 * (len(made) - MAX_PROPOSALS)


def test_the_best_proposals_stay() -> None:
    made = tiles(16)
    best = made.best(MAX_PROPOSALS)
    assert np.array_equal(best.boxes_xyxy, made.boxes_xyxy[-MAX_PROPOSALS:])
    assert best.masks is not None
    assert len(best.masks) == MAX_PROPOSALS
    assert made.best(5000) is made


def test_the_pieces_of_the_strongest_proposals_stay_and_of_these_the_largest() -> None:
    """60 pieces of the best share, 140 of the next, each of another size, and crumbs that are no clusters."""
    sizes = np.array([*range(30, 90), *range(30, 170), *[MIN_PIXELS - 1] * 50])
    share_of = np.repeat([0, 1, 0], [60, 140, 50])
    left = np.array([0, *sizes])
    assert _drop_excess(left, np.array([-1, *share_of])) == 200 - MAX_SEGMENTS
    stay = np.flatnonzero(left[1:] >= MIN_PIXELS)
    assert stay.tolist() == [*range(60), *range(200 - (MAX_SEGMENTS - 60), 200)]


def test_run_json_says_what_was_left_out(tmp_path: Path) -> None:
    many = Proposals(
        np.tile(np.array([[2, 2, 12, 12]], np.int32), (200, 1)), np.linspace(0.1, 1.0, 200, dtype=np.float32)
    )
    recording = FakeRecording(6)
    track_recording(recording, tmp_path / "out", TrackOptions(proposals=lambda frame, camera: many))
    limit = read_run(tmp_path / "out" / "run.json").limits
    assert set(limit) == {"proposals"}
    assert (limit["proposals"].most, limit["proposals"].frames) == (MAX_PROPOSALS, 6)
    assert limit["proposals"].left_out == 6 * 50


@pytest.mark.parametrize(
    ("boxes", "scores", "masks"),
    [
        ([[5, 5, 5, 9]], [0.5], None),
        ([[-1, 0, 5, 5]], [0.5], None),
        ([[0, 0, 5, 5]], [np.nan], None),
        ([[0, 0, 5, 5]], [0.5], (np.ones((5, 6), np.uint8),)),
    ],
    ids=["empty", "outside", "no number", "mask of another size"],
)
def test_what_no_source_may_propose(boxes: list[list[int]], scores: list[float], masks: object) -> None:
    with pytest.raises(ValueError, match=r"proposals need|mask of a box"):
        Proposals(np.array(boxes, np.int32), np.array(scores, np.float32), masks)  # type: ignore[arg-type]


def test_proposals_beyond_the_picture_are_refused() -> None:
    far = Proposals(np.array([[600, 400, 641, 480]], np.int32), np.ones(1, np.float32))
    with pytest.raises(ValueError, match="outside its 640 x 480 pixels"):
        PosedTracker(CAMERA, proposals=lambda frame, camera: far).update(blocks(0, 24))
