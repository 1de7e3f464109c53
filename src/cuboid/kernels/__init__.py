"""Hot loops on flat arrays; each is held against a readable NumPy truth by its test."""

from __future__ import annotations

from pathlib import Path

from cuboid.kernelcache import choose_cache

choose_cache(Path(__file__).parent)
