"""Textures of surfaces as kernels: the fraction of the second color at a place on the body.

Textures of volume (wood, marble, speckle, ...) depend on the position in the body. Textures of surface (print, cloth,
boards, ...) depend on two coordinates along the surface: `s` horizontal and `t` upwards on sides, x and y on level
faces.
"""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.compiling.compiled import kernel

_NOISE_CELLS = 32
NOISE = np.random.default_rng(20).random((_NOISE_CELLS,) * 3, np.float32)


@kernel
def noise_at(noise: Float32Array, x: float, y: float, z: float) -> float:  # pragma: no cover (compiled)
    """Interpolate the periodic noise of a lattice (32, 32, 32), 0..1."""
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    i, j, k = int(fx) & 31, int(fy) & 31, int(fz) & 31
    a, b, c = x - fx, y - fy, z - fz
    a, b, c = a * a * (3 - 2 * a), b * b * (3 - 2 * b), c * c * (3 - 2 * c)
    i1, j1, k1 = (i + 1) & 31, (j + 1) & 31, (k + 1) & 31
    low = (noise[i, j, k] * (1 - a) + noise[i1, j, k] * a) * (1 - b) + (
        noise[i, j1, k] * (1 - a) + noise[i1, j1, k] * a
    ) * b
    high = (noise[i, j, k1] * (1 - a) + noise[i1, j, k1] * a) * (1 - b) + (
        noise[i, j1, k1] * (1 - a) + noise[i1, j1, k1] * a
    ) * b
    return float(low * (1 - c) + high * c)


@kernel
def _cell(noise: Float32Array, x: float, y: float, z: float) -> float:  # pragma: no cover (compiled)
    """Return the random number, 0..1, of the cell of the unit lattice at a position."""
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    return float(noise[(i * 7 + j * 3) & 31, (j * 11 + k * 5) & 31, (k * 13 + i) & 31])


@kernel
def _hash(i: int, j: int, k: int) -> float:  # pragma: no cover (compiled)
    """Return a random number, 0..1, for three integers; it does not repeat, unlike that of `_cell`."""
    h = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791)
    h = ((h ^ (h >> 13)) * 1274126177) & 0x7FFFFFFF
    h = ((h ^ (h >> 15)) * 48271) & 0x7FFFFFFF
    return ((h >> 7) & 0xFFFF) / 65535.0


@kernel
def _limited(value: float) -> float:  # pragma: no cover (compiled)
    return min(max(value, 0.0), 1.0)


@kernel
def fraction_at(
    noise: Float32Array, texture: int, x: float, y: float, z: float, s: float, t: float
) -> float:  # pragma: no cover (compiled)
    """Return the fraction of the second color at a place in units of the texture's scale, 0..1.

    Parameters
    ----------
    noise : (32, 32, 32) float32
        `NOISE`.
    texture : int
        A value of `Texture`.
    x, y, z : float
        Position on the body.
    s, t : float
        Coordinates along the surface.
    """
    if texture < 8:
        return float(_by_position(noise, texture, x, y, z))
    if texture in (8, 9, 10, 11, 18, 19):
        return float(_by_surface(noise, texture, s, t))
    if texture == 12:  # terrazzo: chips of two sizes
        return float(max(_chip(s, t), 0.8 * _chip(2.3 * s + 5, 2.3 * t)))
    if texture == 13:  # carpet: pile, and worn places
        return float(
            _limited(1.6 * noise_at(noise, 3 * x, 3 * y, 3 * z) - 0.5 + 0.4 * noise_at(noise, x / 9, y / 9, z / 9))
        )
    if texture == 14:  # large soft blotches of worn paint
        blotch = noise_at(noise, x, y, z) + 0.4 * noise_at(noise, 3.1 * x, 3.1 * y, 3.1 * z) - 0.55
        return float(_limited(blotch / 0.35))
    if texture == 15:  # strong wood grain along x
        bend = noise_at(noise, x * 0.1, y * 0.6, z * 0.6)
        ring = 0.5 + 0.5 * np.sin(2 * np.pi * (y * 1.4 + 5.0 * bend))
        streak = noise_at(noise, x * 0.5, y * 14.0, z * 14.0)
        return float(_limited(0.7 * ring * ring + 0.75 * streak - 0.25))
    if texture == 16:  # boards with joints
        row = int(np.floor(t))
        along = s / 7.0 + 7.0 * _hash(row, 3, 5)
        board = int(np.floor(along))
        if t - row < 0.025 or (along - board) * 7.0 < 0.03:
            return 1.0
        tone = _hash(row, board, 1)
        grain = noise_at(noise, s * 0.8 + 40 * tone, t * 14.0, 9 * tone)
        return float(_limited(0.5 * tone + 0.7 * grain - 0.3))
    if texture == 17:  # round dots of different size; faces at height 0 cut the cells off their borders
        z += 0.43
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        radius = 0.06 + 0.3 * _hash(i, j, k) ** 2
        room = 0.5 - radius
        dx = x - i - 0.5 - room * (2 * _hash(i, j, k + 71) - 1)
        dy = y - j - 0.5 - room * (2 * _hash(i + 37, j, k) - 1)
        dz = z - k - 0.5 - room * (2 * _hash(i, j + 53, k) - 1)
        return 1.0 if dx * dx + dy * dy + dz * dz < radius * radius else 0.0
    # thin veins
    turbulence = noise_at(noise, x, y, z) + 0.45 * noise_at(noise, 2.9 * x, 2.9 * y, 2.9 * z)
    vein = _limited(1 - 9 * abs(turbulence - 0.72))
    return float(_limited(vein + 0.35 * noise_at(noise, 0.6 * x + 9, 0.6 * y, 0.6 * z)))


@kernel
def _by_position(noise: Float32Array, texture: int, x: float, y: float, z: float) -> float:  # pragma: no cover
    if texture == 1:  # checker
        even = int(np.floor(x + 0.37)) + int(np.floor(y + 0.37)) + int(np.floor(z + 0.37))
        return float(even & 1)
    if texture == 2:  # stripes
        wave = np.sin(2 * np.pi * (0.5 * x + 0.3 * y + z))
        return float(min(max(0.5 + 3.0 * wave, 0.0), 1.0))
    if texture == 3:  # wood: growth rings along x, and its grain
        bend = noise_at(noise, x * 0.13, y * 0.5, z * 0.5)
        ring = 0.5 + 0.5 * np.sin(2 * np.pi * (y * 0.9 + 3.0 * bend))
        return float(0.65 * ring + 0.35 * noise_at(noise, x * 0.8, y * 9.0, z * 9.0))
    if texture == 4:  # marble
        coarse = noise_at(noise, x, y, z)
        veins: float = 0.7 * coarse + 0.5 * noise_at(noise, x * 2.7 + 5, y * 2.7, z * 2.7)
        return min(max(veins - 0.1, 0.0), 1.0)
    if texture == 5:  # bands with print
        band = int(np.floor(z))
        tone = _cell(noise, 3.0, band + 0.5, 11.0)
        part = z - band
        if tone > 0.45 and 0.2 < part < 0.8:
            across = np.arctan2(y, x) * 2.2 + x * 1.1
            return 1.0 if _cell(noise, across * 5.0, part * 5.0, band * 3.0 + 0.5) > 0.55 else 0.1
        return 0.0 if tone > 0.45 else 1.0
    if texture == 6:  # speckle
        return 1.0 if _cell(noise, x * 5.0, y * 5.0, z * 5.0) > 0.82 else 0.0
    if texture == 7:  # tiles with joints
        tile = _cell(noise, x, y, 2.5)
        joint = min(abs(x - np.round(x)), abs(y - np.round(y)))
        return 1.0 if joint < 0.012 else 0.35 * tile + 0.15 * noise_at(noise, x * 6.0, y * 6.0, 0.0)
    return 0.0


@kernel
def _by_surface(noise: Float32Array, texture: int, s: float, t: float) -> float:  # pragma: no cover (compiled)
    i, j = int(np.floor(s)), int(np.floor(t))
    a, b = s - i, t - j
    if texture == 8:
        return float(_print(s, t))
    if texture == 9:  # checked cloth
        return 0.5 * ((i & 1) + (j & 1))
    if texture == 10:  # cloth with stripes of uneven width
        return 1.0 if _hash(int(np.floor(4 * s)) % 14, 7, 1) > 0.6 else 0.0
    if texture == 11:  # flowers: five petals around a middle
        radius = 0.2 + 0.16 * _hash(i, j, 1)
        da, db = a - 0.5 + 0.28 * (_hash(i, j, 2) - 0.5), b - 0.5 + 0.28 * (_hash(i, j, 3) - 0.5)
        d = np.sqrt(da * da + db * db)
        if _hash(i, j, 4) < 0.2 or d > radius * (0.72 + 0.28 * np.cos(5 * np.arctan2(db, da) + 6 * radius)):
            return 0.0
        return 0.35 if d < 0.3 * radius else 1.0
    if texture == 18:  # zigzag
        rise = t + abs(a - 0.5)
        return 1.0 if rise - np.floor(rise) < 0.5 else 0.0
    # bricks with joints
    along = s / 2.6 + 0.5 * (j & 1)
    brick = int(np.floor(along))
    if b < 0.1 or (along - brick) * 2.6 < 0.1:
        return 1.0
    return float(0.45 * _hash(brick, j, 1) + 0.25 * noise_at(noise, 4 * s, 4 * t, 0.5))


@kernel
def _print(s: float, t: float) -> float:  # pragma: no cover (compiled)
    """Print of a label: fields of 14 x 5 lines with text, large letters, a solid block, a disc, or nothing."""
    i, j = int(np.floor(s / 14)), int(np.floor(t / 5))
    a, b = s - 14 * i, t - 5 * j
    kind = _hash(i, j, 11)
    if a < 0.8 or b < 0.4 or kind < 0.25:
        return 0.0
    if kind < 0.6:  # text: the lines have different lengths, words have gaps
        line = int(np.floor(b))
        word = int(np.floor(0.55 * s))
        if b - line < 0.4 or a > 14 * (0.45 + 0.55 * _hash(i, j, line)) or 0.55 * s - word < 0.12:
            return 0.0
        return 1.0 if _hash(int(np.floor(2.4 * s)), 5 * j + line, int(b * 4) & 1) > 0.3 else 0.0
    if kind < 0.74:  # solid block
        return 1.0
    if kind < 0.92:  # large letters of 3 x 5 cells
        letter = int(np.floor(a / 2.6))
        column, row = int((a / 2.6 - letter) * 4), int((b - 0.4) / 4.6 * 6)
        if column == 3 or row == 5:
            return 0.0
        return 1.0 if _hash(letter + 19 * i, 5 * j + row, column) > 0.42 else 0.0
    return 1.0 if (a - 7) ** 2 + (b - 2.7) ** 2 < 2.1**2 else 0.0


@kernel
def _chip(s: float, t: float) -> float:  # pragma: no cover (compiled)
    """Return the tone of the angular chip in the cell of a place, 0 beside it."""
    i, j = int(np.floor(s)), int(np.floor(t))
    a, b = s - i - 0.5, t - j - 0.5
    angle = 6.3 * _hash(i, j, 1)
    u, v = np.cos(angle) * a + np.sin(angle) * b, np.cos(angle) * b - np.sin(angle) * a
    size = 0.15 + 0.3 * _hash(i, j, 2)
    if abs(u) + 0.6 * abs(v) > size or abs(v) > 0.8 * size:
        return 0.0
    return float(0.4 + 0.6 * _hash(i, j, 3))
