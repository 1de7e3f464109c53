"""Keyframes and sightings whose figures can be computed by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Rect = Sequence[float]


def square(x: float, y: float = 0.0, side: float = 10.0) -> list[float]:
    return [x, y, x + side, y + side]


def drawn(number: int, rect: Rect, visible: float | None = None, group: bool = False) -> dict[str, Any]:
    item: dict[str, Any] = {"id": number, "rect": list(rect)}
    if visible is not None:
        item["visible"] = visible
    if group:
        item["group"] = True
    return item


def keyframes_document(
    frames: Mapping[int, Sequence[dict[str, Any]]], ignore: Mapping[int, Sequence[Rect]] | None = None
) -> dict[str, Any]:
    ids = sorted({item["id"] for boxes in frames.values() for item in boxes})
    return {
        "format": "cuboid-keyframes",
        "version": 1,
        "name": "made",
        "objects": [{"id": number, "name": f"thing {number}"} for number in ids],
        "frames": [
            {"frame": frame, "boxes": list(boxes), "ignore": [list(rect) for rect in (ignore or {}).get(frame, ())]}
            for frame, boxes in frames.items()
        ],
    }


def write_keyframes(folder: Path, document: Mapping[str, Any]) -> Path:
    path = folder / "keyframes.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def write_sightings(folder: Path, rows: Sequence[tuple[int, int, Rect]]) -> Path:
    """Write a CSV of frame, label and rectangle."""
    path = folder / "sightings.csv"
    lines = [f"{frame},{label},{','.join(map(str, rect))}" for frame, label, rect in rows]
    path.write_text("\n".join(["frame,label,x0,y0,x1,y1", *lines]) + "\n", encoding="utf-8")
    return path
