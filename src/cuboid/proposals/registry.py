"""The table of proposal sources."""

from __future__ import annotations

from collections.abc import Callable

from cuboid.proposals.types import ProposalSource
from cuboid.registry import Registry

# A factory takes what follows the colon in NAME:OPTIONS, or None without a colon.
SourceFactory = Callable[[str | None], ProposalSource]

SOURCES: Registry[SourceFactory] = Registry("proposal source", "cuboid.proposals")
