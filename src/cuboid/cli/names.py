"""Words that options take: names from the tables in which they are registered, and words that may be left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

# The value of each option where no word follows, and the test whether a word that follows belongs to it.
OPTIONAL: dict[str, tuple[str, Callable[[str], bool]]] = {
    "--json": ("-", lambda word: word == "-" or word.endswith(".json")),
    "--register": ("on", lambda word: word in ("auto", "on", "off")),
    "--serve": ("8764", lambda word: word.isdecimal()),
    "--rerun": ("viewer", lambda word: word.endswith(".rrd") or "://" in word),
}


def without_guessing(words: Sequence[str]) -> list[str]:
    """Return a command line in which these options take no word that is not for them, a recording's name say."""
    words = list(words)
    for k, word in enumerate(words):
        if word in OPTIONAL:
            alone, fits = OPTIONAL[word]
            if k + 1 == len(words) or not fits(words[k + 1]):
                words[k] = f"{word}={alone}"
    return words


def format_names() -> list[str]:
    """Return the names of the layouts of recordings."""
    from cuboid.readers import READERS

    return READERS.names()


def detector_names() -> list[str]:
    """Return the names of the detectors that have one."""
    from cuboid.detection import DETECTORS

    return DETECTORS.names()


def proposal_names() -> list[str]:
    """Return the names of the sources of 2D proposals."""
    from cuboid.proposals import SOURCES

    return SOURCES.names()


def setting_names() -> list[str]:
    """Return the fields of the tracker's configuration."""
    from dataclasses import fields

    from cuboid.core.config import TrackerConfig

    return [item.name for item in fields(TrackerConfig)]


def export_names() -> dict[str, str]:
    """Return the names of the forms of results, each with what it is for."""
    from cuboid.exports import EXPORTS

    return {name: form.purpose for name, form in EXPORTS.items()}


def scene_export_names() -> dict[str, str]:
    """Return the forms in which results of a scene are written, each with what it is for."""
    return {"results": "all commands that take results: a result folder", **export_names()}


def camera_names() -> list[str]:
    """Return the names of the live cameras."""
    from cuboid.cameras import CAMERAS

    return CAMERAS.names()
