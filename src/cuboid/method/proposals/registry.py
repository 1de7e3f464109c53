"""The table of proposal sources."""

from __future__ import annotations

from collections.abc import Callable

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.registry import Registry
from cuboid.method.proposals.types import ProposalSource

# A factory takes the OPTIONS of NAME:OPTIONS, or None without a colon, and the tracker's settings: the source uses
# their object sizes, depth range and noise.
SourceFactory = Callable[[str | None, TrackerConfig], ProposalSource]

SOURCES: Registry[SourceFactory] = Registry("proposal source", "cuboid.proposals")
