"""Names that options take, from the tables in which they are registered; imported when they are needed."""

from __future__ import annotations


def format_names() -> list[str]:
    """Return the names of the layouts of recordings."""
    from cuboid.readers import READERS

    return READERS.names()


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
