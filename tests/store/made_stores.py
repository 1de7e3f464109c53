"""Stores whose every row is known, made without tracking anything."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from cuboid.fleet.store.files import Part, key_of
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.rows import day_of
from cuboid.fleet.store.schema import DONE, OBJECTS, RECORDINGS, RUNS, SIGHTINGS, TABLES
from cuboid.services.queries.likeness import COLOR_WORDS, SHAPE_BINS

BEGIN = datetime(2026, 3, 1, 12, tzinfo=UTC)


def run_of(k: int) -> str:
    return f"{k:020x}"


def colors_of(word: str) -> list[float]:
    return [float(word == one) for one in COLOR_WORDS]


def thing(label: int, **columns: Any) -> dict[str, Any]:
    """A grey cube of 10 cm in the origin, but for what is said."""
    color = columns.get("color", "grey")
    return {
        "label": label,
        **{f"center_{axis}_m": 0.0 for axis in "xyz"},
        **dict.fromkeys(("longest_m", "middle_m", "shortest_m", "length_m", "width_m", "height_m"), 0.1),
        "qw": 1.0,
        "qx": 0.0,
        "qy": 0.0,
        "qz": 0.0,
        "score": columns.get("probability", 0.9),
        "probability": 0.9,
        "gone": False,
        "frames_seen": 10,
        "last_seen": BEGIN,
        "color": color,
        "colors": colors_of(color),
        "shape": [1.0 / SHAPE_BINS] * SHAPE_BINS,
        **columns,
    }


def put_run(
    place: StoreFolder, k: int, things: list[dict[str, Any]], *, recording: str = "", state: str = DONE, **columns: Any
) -> Part:
    """Put a run and its objects into a store, as a task does."""
    name = recording or f"rec-{k}"
    moment = BEGIN + timedelta(days=k % 3)
    part = Part(key_of(run_of(k), state), day_of(moment))
    whose = {"run": run_of(k), "recording": name}
    counts = {"frames_read": 10, "frames_used": 10, "objects": len(things), "labels": len(things), "stages": []}
    counts |= dict.fromkeys(("overlapping", "floating", "brief"), 0)
    head = {**whose, "source": f"/data/{name}", "state": state, "version": "1", "settings": "{}"}
    head["finished"] = BEGIN + timedelta(days=k)
    rows = {
        RECORDINGS: [{**whose, "recorded": moment}],
        OBJECTS: [{**whose, **one} for one in things],
        SIGHTINGS: [{**whose, "frame": frame, "label": one["label"]} for one in things for frame in range(3)],
        RUNS: [{**head, **(counts if state == DONE else {}), **columns}],
    }
    for table, file in sorted(part.names().items(), key=lambda item: item[0] == RUNS):
        place.put_table(file, TABLES[table].table(rows[table]), TABLES[table].group_rows)
    return part
