"""Annotation of keyframes in the browser: rectangles with object identities, to evaluate results."""

from __future__ import annotations

from cuboid.lab.annotation.server import Annotator, make_server
from cuboid.lab.annotation.store import KeyframesFile

__all__ = ["Annotator", "KeyframesFile", "make_server"]
