"""Batches as processes, with real workers and a tracker that is quick; and what they left, ready to be compared."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa

import cuboid
from cuboid.cli.batch import add_arguments, settings_from
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.schema import MEASURED, RUNS, TABLES
from fakes import write_recording

HERE = Path(__file__).resolve().parent
# The package under test, which need not be the installed one.
SOURCE = Path(cuboid.__file__).resolve().parents[1]

# What hangs ends after so long. It says nothing about how quick anything is: a busy machine takes minutes where a
# quiet one takes seconds, for each worker that is started, or started again, loads all packages.
LIMIT_S = 600


def surroundings(frame_s: float = 0.0) -> dict[str, str]:
    """The environment in which workers load the quick tracker."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join((str(HERE), str(HERE.parent), str(SOURCE))),
        "DASK_DISTRIBUTED__WORKER__PRELOAD": '["quick_workers"]',
        "CUBOID_TEST_FRAME_S": str(frame_s),
        # As on a machine so busy that a worker takes long to come again: Dask must not give it up.
        "DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "100ms",
    }


def settings_of(*words: object) -> dict[str, Any]:
    """The settings of a batch that is called with these words."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return settings_from(parser.parse_args([*map(str, words), "--output", "unused"]))


def call(*words: object) -> list[str]:
    """The command line of cuboid."""
    return [sys.executable, "-m", "cuboid", *map(str, words)]


def run(*words: object, frame_s: float = 0.0) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        call(*words), capture_output=True, text=True, timeout=LIMIT_S, check=False, env=surroundings(frame_s)
    )


def recordings(folder: Path, count: int, frames: int = 6) -> Path:
    """Write recordings a and so on; each a second younger than the one before."""
    for k in range(count):
        one = write_recording(folder / f"rec-{k:02d}", frames)
        for file in one.rglob("*.*"):
            os.utime(file, (1_700_000_000 + k, 1_700_000_000 + k))
    return folder


def paint(recording: Path, value: int) -> None:
    """Make all color images of a recording of one brightness."""
    for file in (recording / "color").iterdir():
        cv2.imwrite(str(file), np.full((48, 64, 3), value, np.uint8))


def content(store: Path | str) -> dict[str, bytes]:
    """The tables without what a clock decides, sorted, as bytes."""
    tables = Tables(str(store))
    found = {}
    for name, kind in TABLES.items():
        kept = [column.name for column in kind.columns if column.name not in MEASURED or name != RUNS]
        table = tables.ask(f"select {', '.join(kept)} from {name}")
        table = table.sort_by([(column, "ascending") for column in kind.order if column in kept]).combine_chunks()
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, table.schema.remove_metadata()) as stream:
            stream.write_table(table.replace_schema_metadata(None))
        found[name] = sink.getvalue().to_pybytes()
    return found


def states(store: Path | str) -> dict[str, tuple[str, str | None]]:
    """State and reason of each recording."""
    rows = Tables(str(store)).rows("select recording, state, reason from runs")
    assert len(rows) == len({row["recording"] for row in rows}), "a recording is there twice"
    return {row["recording"]: (row["state"], row["reason"]) for row in rows}
