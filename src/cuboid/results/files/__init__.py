"""The result files of a run: written row by row, visible only when complete, and read again."""

from __future__ import annotations

from cuboid.ground.formats.run_file import LimitReached, Timing
from cuboid.results.files.objects import ObjectsFile, read_objects, write_objects
from cuboid.results.files.opened import FrameRecord, Results, open_results
from cuboid.results.files.ply import read_map, write_map
from cuboid.results.files.report import RunReport, read_run, write_run
from cuboid.results.files.rows import (
    PoseRow,
    ProposalRow,
    TrackRow,
    read_proposals,
    read_tracks,
    read_trajectory,
)
from cuboid.results.files.writer import ResultWriter

__all__ = [
    "FrameRecord",
    "LimitReached",
    "ObjectsFile",
    "PoseRow",
    "ProposalRow",
    "ResultWriter",
    "Results",
    "RunReport",
    "Timing",
    "TrackRow",
    "open_results",
    "read_map",
    "read_objects",
    "read_proposals",
    "read_run",
    "read_tracks",
    "read_trajectory",
    "write_map",
    "write_objects",
    "write_run",
]
