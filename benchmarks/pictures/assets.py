"""The files of robosuite: textures for walls, floors and table tops, and its folder."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

import cv2
import numpy as np
from meshes import Image

# Widest side of a texture, pixels.
MAX_TEXTURE_PX = 512


@functools.cache
def robosuite_folder() -> Path:
    """Return the folder of the assets of the installed robosuite, which is not imported."""
    found = importlib.util.find_spec("robosuite")
    if found is None or not found.submodule_search_locations:
        raise ImportError("robosuite is missing: pip install --no-deps -r benchmarks/pictures/requirements.txt")
    return Path(next(iter(found.submodule_search_locations))) / "models" / "assets"


def shrunk(image: Image) -> Image:
    """Return an image whose sides are at most MAX_TEXTURE_PX."""
    factor = MAX_TEXTURE_PX / max(image.shape[:2])
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor < 1 else image.copy()
    return np.asarray(small, np.uint8)


@functools.cache
def texture_files() -> list[Path]:
    """Return the textures for walls, floors and table tops."""
    no_surfaces = {"bread", "can", "cereal", "lemon", "soda", "glass", "dirt"}
    return sorted(f for f in (robosuite_folder() / "textures").glob("*.png") if f.stem not in no_surfaces)


@functools.lru_cache(maxsize=64)
def load_texture(path: Path) -> Image:
    """Return a texture file as RGB (h, w, 3)."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert image is not None, path
    return shrunk(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8))
