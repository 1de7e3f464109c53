"""Annotation of keyframes in the browser: rectangles with object identities, to evaluate results."""

from __future__ import annotations

from cuboid.annotation.server import Annotator, make_server
from cuboid.annotation.store import KeyframesFile

__all__ = ["Annotator", "KeyframesFile", "make_server"]
