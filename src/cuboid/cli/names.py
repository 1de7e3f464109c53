"""Values of options: registered names, and the values of options that need none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

# For each option with an optional value: the value if no word follows, and a test whether the next word is its value.
OPTIONAL: dict[str, tuple[str, Callable[[str], bool]]] = {
    "--foxglove": ("127.0.0.1:8765", lambda word: word.rpartition(":")[2].isdigit()),
    "--json": ("-", lambda word: word == "-" or word.endswith(".json")),
    "--register": ("on", lambda word: word in ("auto", "on", "off")),
    "--serve": ("8764", lambda word: word.isdecimal()),
    "--rerun": ("viewer", lambda word: word.endswith(".rrd") or "://" in word),
}


def without_guessing(words: Sequence[str]) -> list[str]:
    """Return the command line with explicit values, so that these options do not take the next argument as a value."""
    words = list(words)
    for k, word in enumerate(words):
        if word in OPTIONAL:
            alone, fits = OPTIONAL[word]
            if k + 1 == len(words) or not fits(words[k + 1]):
                words[k] = f"{word}={alone}"
    return words


def registered(module: str, registry: str) -> Callable[[], list[str]]:
    """Return a function that imports a module, and returns the names in one of its registries."""

    def names() -> list[str]:
        found: list[str] = getattr(import_module(module), registry).names()
        return found

    return names


# The names of recording layouts, detectors, sources of 2D proposals, and live cameras.
format_names = registered("cuboid.inputs.readers", "READERS")
detector_names = registered("cuboid.method.detection", "DETECTORS")
proposal_names = registered("cuboid.method.proposals", "SOURCES")
camera_names = registered("cuboid.inputs.cameras", "CAMERAS")


def setting_names() -> list[str]:
    """Return the fields of the tracker's configuration."""
    from dataclasses import fields

    from cuboid.ground.core.config import TrackerConfig

    return [item.name for item in fields(TrackerConfig)]


def export_names() -> dict[str, str]:
    """Return the names of the export formats, each with its purpose."""
    from cuboid.results.exports import EXPORTS

    return {name: form.purpose for name, form in EXPORTS.items()}


def scene_export_names() -> dict[str, str]:
    """Return the names of the formats in which results of a scene are exported, each with its purpose."""
    return {"results": "all commands that take results: a result folder", **export_names()}
