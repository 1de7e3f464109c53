"""Drawing keyframes in the browser: rectangles with identities, by which a result can be judged."""

from __future__ import annotations

from cuboid.annotation.server import Annotator, make_server
from cuboid.annotation.store import KeyframesFile

__all__ = ["Annotator", "KeyframesFile", "make_server"]
