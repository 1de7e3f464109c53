"""The version of Cuboid, which the package's metadata, `run.json` and the servers give."""

from __future__ import annotations

__version__ = "0.2.0"
