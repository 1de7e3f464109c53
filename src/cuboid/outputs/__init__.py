"""The result files of a run: written row by row, visible only when complete, and read again."""

from __future__ import annotations

from cuboid.formats.run_file import LimitReached, Timing
from cuboid.outputs.folder import OUTPUT_NAMES, ResultFolder
from cuboid.outputs.objects import ObjectsFile, read_objects, write_objects
from cuboid.outputs.opened import FrameRecord, Results, open_results
from cuboid.outputs.ply import read_map, write_map
from cuboid.outputs.report import RunReport, read_run, write_run
from cuboid.outputs.rows import (
    PoseRow,
    ProposalRow,
    TrackRow,
    read_proposals,
    read_tracks,
    read_trajectory,
)
from cuboid.outputs.writer import ResultWriter

__all__ = [
    "OUTPUT_NAMES",
    "FrameRecord",
    "LimitReached",
    "ObjectsFile",
    "PoseRow",
    "ProposalRow",
    "ResultFolder",
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
