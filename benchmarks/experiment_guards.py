"""The cost of validating files: reading with and without validation, alternately.

Without validation an image is decoded, JSON is parsed, and the cells of tables are converted to numbers; no field is
checked. The difference is compared with the time of the next step: tracking a frame, or evaluating a result.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.objects_file import ObjectsDocument
from cuboid.ground.formats.rows_files import ProposalEntry, TrackEntry
from cuboid.ground.formats.run_file import RunDocument
from cuboid.ground.formats.table_validation import read_table
from cuboid.ground.formats.truth_file import TruthDocument
from cuboid.inputs.readers.image_folder import IMAGE_ENDINGS
from cuboid.inputs.readers.images import decode_color, decode_depth
from cuboid.lab.evaluation import evaluate
from cuboid.runs.pipeline.options import TrackOptions
from scenes import cases
from scoring import run_and_score
from tables import cell, dump, show

# Number of images per repetition, and of repetitions.
IMAGES, REPETITIONS = 40, 15
JSON = {"objects.json": ObjectsDocument, "run.json": RunDocument}
TABLES = {"tracks.csv": TrackEntry, "proposals.csv": ProposalEntry}
HEADER = ("input", "validated ms", "not validated ms", "next step", "next step ms", "validation, % of both")


def run(args: argparse.Namespace) -> None:
    """Print the table, or all figures."""
    case = cases(args.kinds, args.seeds, args.work, args.data)[-1]
    folder = args.work / "runs" / "guards" / case.name
    ran = run_and_score(case, folder, TrackOptions(every=args.every, limit=args.limit))
    rows = []
    for what, validated, plain in (("color", decode_color, _color), ("depth", decode_depth, _depth)):
        images = _images(case.recording, what)
        tracking_ms = ran["ms_frame"] - ran["ms_stages"]["decode"]
        checked = _each(lambda path, read=validated: read(path, path.name), images)
        both = _alternately(checked, _each(plain, images), len(images))
        rows.append(_row(f"a {what} image", *both, "tracking a frame", tracking_ms))
    both = _alternately(lambda: _checked(folder, case.truth), lambda: _plain(folder, case.truth), 1)
    whole_ms = float(np.median([_ms(lambda: evaluate(folder, case.truth)) for _ in range(5)]))
    rows.append(_row("a result and its truth", *both, "evaluating it", whole_ms - both[0]))
    if args.json:
        dump(rows)
        return
    lines = [
        [
            row["what"],
            *(cell(row[name], 2) for name in ("validated_ms", "plain_ms")),
            row["next_step"],
            cell(row["next_ms"], 1),
            cell(row["validation_percent"], 2),
        ]
        for row in rows
    ]
    show(f"Validation, on {case.name}: median of {REPETITIONS} repetitions, processor time", HEADER, lines)


def _row(what: str, validated_ms: float, plain_ms: float, next_step: str, next_ms: float) -> dict[str, Any]:
    percent = 100 * (validated_ms - plain_ms) / (validated_ms + next_ms)
    return {
        "what": what,
        "validated_ms": validated_ms,
        "plain_ms": plain_ms,
        "next_step": next_step,
        "next_ms": next_ms,
        "validation_percent": percent,
    }


def _each(read: Callable[[Path], Any], paths: list[Path]) -> Callable[[], Any]:
    return lambda: [read(path) for path in paths]


def _alternately(one: Callable[[], Any], other: Callable[[], Any], count: int) -> tuple[float, float]:
    """Return the median times of both calls, ms per item; the first repetition fills caches, and is omitted."""
    times = [(_ms(one), _ms(other)) for _ in range(REPETITIONS + 1)][1:]
    return float(np.median([a for a, _ in times])) / count, float(np.median([b for _, b in times])) / count


def _ms(call: Callable[[], Any]) -> float:
    begun_s = time.process_time()
    call()
    return 1e3 * (time.process_time() - begun_s)


def _images(recording: Path, what: str) -> list[Path]:
    named = (path for path in recording.rglob(f"*{what}*") if path.is_dir() or path.suffix in IMAGE_ENDINGS)
    files = [file for path in named for file in ([path] if path.is_file() else path.iterdir())]
    return sorted(files)[:IMAGES]


def _color(path: Path) -> Any:
    return cv2.imdecode(
        np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    )


def _depth(path: Path) -> Any:
    return cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)


def _checked(folder: Path, truth: Path) -> Any:
    documents = [read_json(folder / name, kind) for name, kind in JSON.items()]
    return (
        documents,
        read_json(truth, TruthDocument),
        [list(read_table(folder / n, kind)) for n, kind in TABLES.items()],
    )


def _plain(folder: Path, truth: Path) -> Any:
    documents = [json.loads(path.read_bytes()) for path in (*(folder / name for name in JSON), truth)]
    tables = []
    for name in TABLES:
        with (folder / name).open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))[1:]
        tables.append(np.array([[float(cell) if cell else math.nan for cell in row] for row in rows]))
    return documents, tables
