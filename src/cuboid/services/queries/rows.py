"""Found objects as rows of printed tables, of pages, and for JSON; the same for a store and for one place."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from cuboid.services.queries.answers import FoundObject


def row_of(found: FoundObject, title: str, picture: bytes | None = None) -> dict[str, Any]:
    """Return an object of a place with the columns of `cuboid find` in a store.

    Parameters
    ----------
    found : FoundObject
    title : str
        Title of the place.
    picture : bytes, optional
    """
    seen = found.last_seen.time
    return {
        "recording": title,
        "label": found.label,
        **dict(zip(("longest_m", "middle_m", "shortest_m"), sorted(found.size_m, reverse=True), strict=True)),
        **dict(zip(("center_x_m", "center_y_m", "center_z_m"), found.center_m, strict=True)),
        "name": found.name,
        "color": found.color,
        "score": found.score,
        "probability": found.probability,
        "frames_seen": found.frames_seen,
        "first_frame": found.first_seen.frame,
        "last_frame": found.last_seen.frame,
        "last_seen": None if seen is None else datetime.fromisoformat(seen),
        "run": None,
        **({} if found.distance_m is None else {"distance_m": found.distance_m}),
        **({} if found.text_score is None else {"text_score": found.text_score}),
        **({} if picture is None else {"picture": picture}),
    }


def cells_of(row: Mapping[str, Any]) -> list[str]:
    """Return the cells of an object in tables: name, size, position, color, probability, frames, last sighting."""
    size = " x ".join(f"{100 * row[side]:.1f}" for side in ("longest_m", "middle_m", "shortest_m"))
    place = ", ".join(f"{row[f'center_{axis}_m']:z.2f}" for axis in "xyz")
    seen = row["last_seen"]
    when = "" if seen is None else f"{seen:%Y-%m-%d %H:%M:%S}"
    name = f" {row['name']}" if row.get("name") else ""
    likely = "" if row["probability"] is None else f"{row['probability']:.2f}"
    first = [f"{row['recording']}#{row['label']}{name}", size, place, row["color"] or "", likely]
    return [*first, str(row["frames_seen"]), when]


def plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row ready for JSON, without its picture."""
    kept = {name: value for name, value in row.items() if name != "picture"}
    return {
        name: value.isoformat()
        if isinstance(value, datetime)
        else round(value, 6)
        if isinstance(value, float)
        else value
        for name, value in kept.items()
    }
