from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.results.files import ObjectsFile, ResultWriter, RunReport, Timing
from cuboid.results.views.replay import Replay

EVERY = 3


def box(x: float) -> Box:
    return Box(np.array([x, 0.0, 1.0]), np.full(3, 0.2), np.eye(3))


def write(path: Path) -> None:
    """Every third frame; 6 is skipped; label 2 is merged into 1 at the end, label 3 comes late and goes."""
    seen = {0: (), 3: (1, 2), 9: (2,), 12: (3,), 15: ()}
    with ResultWriter(path) as writer:
        for index, labels in seen.items():
            sightings = tuple(Sighting(label, box(index + label), None, 1.0, np.zeros(4)) for label in labels)
            heat = np.zeros((4, 4), np.float32)
            writer.add(FrameResult(index, index / 30.0, np.eye(4), sightings, (), 0, heat, {}))
        objects = tuple(TrackedObject(label, box(0.0), 1.0, 1.0, 0, 9, 3, 9, np.zeros(3), None) for label in (1, 3))
        found = ObjectsFile(None, Intrinsics(5, 5, 2, 2, 4, 4), (), objects)
        report = RunReport(
            "0",
            True,
            "recording",
            "plain",
            "given",
            1,
            {"every": EVERY},
            6,
            5,
            ((6, "bad"),),
            {"frame": Timing(25.0, 30.0)},
            1.0,
            1.0,
        )
        points = MapPoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))
        writer.finish(found, points, report)


def test_a_run_is_replayed_as_its_files_tell_it(tmp_path: Path) -> None:
    write(tmp_path / "results")
    replay = Replay(tmp_path / "results")
    frames = list(replay.frames(lambda index: index / 30.0))
    assert [found.index for found in frames] == [0, 3, 9, 12, 15]
    assert [[row.label for row in found.sightings] for found in frames] == [[], [1, 2], [2], [3], []]
    # Label 2 is an object of its own only while it is seen: objects.json does not have it.
    assert [[item.label for item in found.hidden] for found in frames] == [[], [], [1], [1], [1, 3]]
    assert [found.objects_known for found in frames] == [0, 2, 2, 2, 2]
    assert frames[2].hidden[0].box.center[0] == 4.0  # where it was last seen
    assert (len(replay), replay.last_frame, replay.every) == (5, 15, EVERY)
    assert replay.intrinsics.width == 4
