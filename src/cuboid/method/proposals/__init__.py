"""2D proposals: scored boxes or masks of possible objects in a frame; later stages do not depend on their source."""

from __future__ import annotations

from cuboid.ground.core.config import TrackerConfig

# Each import registers its source.
from cuboid.method.proposals import bing as _bing  # noqa: F401
from cuboid.method.proposals import depth as _depth  # noqa: F401
from cuboid.method.proposals import edgeboxes as _edgeboxes  # noqa: F401
from cuboid.method.proposals import onnx as _onnx  # noqa: F401
from cuboid.method.proposals import precomputed as _precomputed  # noqa: F401
from cuboid.method.proposals import regions as _regions  # noqa: F401
from cuboid.method.proposals import selective_search as _selective_search  # noqa: F401
from cuboid.method.proposals.registry import SOURCES, SourceFactory
from cuboid.method.proposals.types import Proposals, ProposalSource

__all__ = ["DEFAULT_SOURCE", "SOURCES", "ProposalSource", "Proposals", "SourceFactory", "make_source", "source_name"]

# Chosen by measurement: see benchmarks/proposal_sources.py.
DEFAULT_SOURCE = "depth"


def make_source(spec: str | ProposalSource | None = None, config: TrackerConfig | None = None) -> ProposalSource:
    """Return the proposal source that `spec` names.

    Parameters
    ----------
    spec : str, ProposalSource or None
        ``NAME`` or ``NAME:OPTIONS``; any callable from (frame, intrinsics) to `Proposals` is returned as it is;
        None is the default source.
    config : TrackerConfig, optional
        Its object sizes, depth range and noise are used by sources that are named by `spec`.

    Raises
    ------
    InputError
        If no source has that name, or it cannot use the options.
    MissingExtraError
        If the source needs a package that is not installed.
    """
    if spec is None:
        spec = DEFAULT_SOURCE
    if not isinstance(spec, str):
        return spec
    name, colon, options = spec.partition(":")
    return SOURCES.get(name)(options if colon else None, config or TrackerConfig())


def source_name(spec: str | ProposalSource | None) -> str:
    """Return the name of the source that `make_source` makes of `spec`, for reports."""
    source = DEFAULT_SOURCE if spec is None else spec
    return source if isinstance(source, str) else type(source).__qualname__
