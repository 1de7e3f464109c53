"""How fast a million objects are asked: a made store, and what questions to it take on one core.

python benchmarks/objects.py --store DIR [--days 25] [--recordings 4000] [--objects 10]

DIR gets so many recordings a day with so many objects each, as a batch and a compaction leave them.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa

from cuboid.fleet.store.files import Manifest, manifest_name, name_of
from cuboid.fleet.store.find import find
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.schema import DONE, OBJECTS, RUNS, TABLES, TIME
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.likeness import COLOR_WORDS, SHAPE_BINS
from tables import show

QUESTIONS = {
    "size and place": Filters(size_m=(0.08, 0.14), near=(1.0, 2.0, 0.5), within_m=0.5),
    "size": Filters(size_m=(0.08, 0.14)),
    "color and size": Filters(color="red", size_m=(0.08, 0.14)),
    "like": Filters(like=("kitchen-777", 3)),
    "like, of a size": Filters(like=("kitchen-777", 3), size_m=(0.08, 0.14)),
}
TIMES = 5


def make(place: StoreFolder, days: int, recordings: int, objects: int) -> None:
    """Write the store: sizes are log-normal about 14 cm, places fill 20 x 20 x 2 m."""
    rng = np.random.default_rng(0)
    files: dict[str, list[str]] = {RUNS: [], OBJECTS: []}
    for d in range(days):
        day = datetime(2026, 3, 1, tzinfo=UTC) + timedelta(days=d)
        names = [f"kitchen-{d * recordings + k}" for k in range(recordings)]
        runs = [f"{d * recordings + k:020x}" for k in range(recordings)]
        rows = {RUNS: _runs(runs, names, day, objects), OBJECTS: _objects(rng, runs, names, day, objects)}
        for table, columns in rows.items():
            kind, count = TABLES[table], len(columns["run"])
            arrays = [
                pa.array(columns[c.name], c.type) if c.name in columns else pa.nulls(count, c.type)
                for c in kind.columns
            ]
            name = name_of(table, f"day={day.date()}", f"gathered-{d:020x}")
            place.put_table(name, kind.sorted(pa.table(arrays, schema=kind.schema)), kind.group_rows)
            files[table].append(name)
    place.create(manifest_name(1), msgspec.json.encode(Manifest(files=files)))


def _runs(runs: list[str], names: list[str], day: datetime, objects: int) -> dict[str, Any]:
    n = len(runs)
    return {
        "run": runs,
        "recording": names,
        "source": [f"/data/{name}" for name in names],
        "state": [DONE] * n,
        "version": ["1"] * n,
        "settings": ["{}"] * n,
        "finished": [day] * n,
        "objects": [objects] * n,
    }


def _objects(
    rng: np.random.Generator, runs: list[str], names: list[str], day: datetime, objects: int
) -> dict[str, Any]:
    n = len(runs) * objects
    sides = -np.sort(-rng.lognormal(-2, 0.6, (n, 3)), axis=1)
    center = np.column_stack((rng.uniform(-10, 10, (n, 2)), rng.uniform(0, 2, n))).round(6)
    colors, shape = (rng.gamma(a, 1, (n, bins)) for a, bins in ((0.3, len(COLOR_WORDS)), (1.0, SHAPE_BINS)))
    return {
        "run": np.repeat(runs, objects),
        "recording": np.repeat(names, objects),
        "label": np.tile(np.arange(1, objects + 1), len(runs)),
        **{f"center_{axis}_m": center[:, k] for k, axis in enumerate("xyz")},
        **{side: sides[:, k] for k, side in enumerate(("longest_m", "middle_m", "shortest_m"))},
        "score": rng.uniform(0.5, 1, n),
        "frames_seen": rng.integers(3, 500, n),
        "last_seen": pa.array([day] * n, TIME),
        "color": np.array(COLOR_WORDS)[colors.argmax(1)],
        "colors": _lists(colors),
        "shape": _lists(shape),
    }


def _lists(rows: np.ndarray[Any, Any]) -> pa.Array:
    """Return histograms as a column of lists."""
    fractions = (rows / rows.sum(axis=1, keepdims=True)).round(3).astype(np.float32)
    offsets = np.arange(0, fractions.size + 1, fractions.shape[1], dtype=np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(fractions.ravel()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", type=Path, required=True, metavar="DIR")
    parser.add_argument("--days", type=int, default=25, metavar="N")
    parser.add_argument("--recordings", type=int, default=4000, metavar="N")
    parser.add_argument("--objects", type=int, default=10, metavar="N")
    args = parser.parse_args()
    if not args.store.exists():
        make(StoreFolder(str(args.store)), args.days, args.recordings, args.objects)
        print("made; call it again to measure", file=sys.stderr)  # whose memory is not that of the questions
        return 0
    begun_s = time.perf_counter()
    tables = Tables(str(args.store))
    opened_s = time.perf_counter() - begun_s
    lines = []
    for name, filters in QUESTIONS.items():
        wall, cpu = [], []
        for _ in range(TIMES):
            begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
            found = find(tables, filters)
            wall.append(1e3 * (time.perf_counter() - begun_s))
            cpu.append(1e3 * (time.process_time() - begun_cpu_s))
        lines.append([name, len(found), float(np.median(wall)), max(wall), float(np.median(cpu)), max(cpu)])
    (count,) = tables.rows("select count(*) as n from objects")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    title = f"{count['n']:,} objects; opened in {1e3 * opened_s:.0f} ms; peak memory {peak_mb:.0f} MB"
    show(title, ("question", "found", "ms, median", "ms, worst", "cpu ms, median", "cpu ms, worst"), lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
