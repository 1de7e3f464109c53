"""Shading of hits to a color image: Lambert's law with a lamp and ambient light, and textures by position.

The lamp consists of a few points, so that shadows have soft edges. Shadow rays are cast for every second pixel of every
second row, and the results are spread to neighbours on the same part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.compiling.compiled import kernel
from cuboid.lab.synthetic.material import Material, linear
from cuboid.lab.synthetic.raycast import SHADOW_BIAS_M, Hits, RayCaster

# Ambient light on a surface that faces down, and on one that faces up; the rest comes from the lamp.
AMBIENT_DOWN, AMBIENT_UP = 0.27, 0.42
# The lamp's light at a distance of 1 m, which falls with the square of the distance, and its maximum.
LAMP, LAMP_MOST = 4.8, 1.3
# Strength of highlights.
GLOSS = 0.55
# Size of the fine texture noise of every surface, metres.
FINE_M = 0.012
# The blur of a small lens, pixels; it also smooths the aliasing of one ray per pixel.
BLUR_PX = 0.55
# Noise of the color sensor, grey levels.
COLOR_NOISE = 1.6

_NOISE_CELLS = 32
_NOISE = np.random.default_rng(20).random((_NOISE_CELLS,) * 3, np.float32)
_GAMMA = np.rint(np.linspace(0.0, 1.0, 4096) ** (1 / 2.2) * 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class ShadingParameters:
    """The surfaces of a scene, as tables for the shading.

    Attributes
    ----------
    face_part : (F,) int32
    normals : (F, 3, 3) float32
        Normals of each face's corners, in the room.
    parts : (P, 21) float64
        color, second (linear), texture, scale, shine, T_body_room (3 x 4, by rows).
    lamp : (L, 3) float64
        Points of the lamp, in the room.
    """

    face_part: npt.NDArray[np.int32]
    normals: Float32Array
    parts: Float64Array
    lamp: Float64Array


def part_rows(materials: Sequence[Material], T_body_room: Sequence[Float64Array]) -> Float64Array:
    """Return the table `ShadingParameters.parts`."""
    rows = np.empty((len(materials), 21))
    for row, look, T in zip(rows, materials, T_body_room, strict=True):
        row[0:3], row[3:6] = linear(look.color), linear(look.second)
        row[6:9] = look.texture, look.scale_m, look.shine
        row[9:] = T[:3].reshape(-1)
    return rows


def shade(
    caster: RayCaster,
    look: ShadingParameters,
    hits: Hits,
    rng: np.random.Generator,
) -> tuple[UInt8Array, Float32Array]:
    """Return the color image (H, W, 3) RGB, and the cosine of each pixel's ray to its surface (H, W)."""
    shape = hits.depth_m.shape
    points, normals = np.empty((2, *shape, 3), np.float32)
    cosine = np.empty(shape, np.float32)
    _places(hits.depth_m, hits.face, hits.u, hits.v, hits.rays, hits.eye, look.normals, points, normals, cosine)
    lit = _lit_fraction(caster, look, points[::2, ::2], normals[::2, ::2])
    part = np.where(hits.face >= 0, look.face_part[hits.face], np.int32(-1))
    color = np.empty((*shape, 3), np.uint8)
    _colors(part, points, normals, hits.eye, look.parts, look.lamp.mean(axis=0), lit, _NOISE, _GAMMA, color)
    color = cv2.GaussianBlur(color, (0, 0), BLUR_PX)
    noise = rng.standard_normal(shape, np.float32) * np.float32(COLOR_NOISE)
    noisy: UInt8Array = cv2.add(color, cv2.merge([noise] * 3), dtype=cv2.CV_8U).astype(np.uint8, copy=False)
    return noisy, cosine


def _lit_fraction(
    caster: RayCaster, look: ShadingParameters, points: Float32Array, normals: Float32Array
) -> Float32Array:
    """Return the visible fraction of the lamp (h, w) for points (h, w, 3) with normals (h, w, 3)."""
    start = np.ascontiguousarray((points + normals * np.float32(SHADOW_BIAS_M)).reshape(-1, 3))
    lit = np.zeros(len(start), np.float32)
    for point in look.lamp:
        lit += caster.reaches(start, point)
    return (lit / np.float32(len(look.lamp))).reshape(points.shape[:2])


@kernel
def _noise_at(noise: Float32Array, x: float, y: float, z: float) -> float:  # pragma: no cover (compiled)
    """Interpolate the periodic noise of a 32 x 32 x 32 lattice, 0..1."""
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
def _second_fraction(
    noise: Float32Array, texture: int, x: float, y: float, z: float
) -> float:  # pragma: no cover (compiled)
    """Return the fraction of the second color at a place in units of the texture's scale, 0..1."""
    if texture == 1:  # checker
        even = int(np.floor(x + 0.37)) + int(np.floor(y + 0.37)) + int(np.floor(z + 0.37))
        return float(even & 1)
    if texture == 2:  # stripes
        wave = np.sin(2 * np.pi * (0.5 * x + 0.3 * y + z))
        return float(min(max(0.5 + 3.0 * wave, 0.0), 1.0))
    if texture == 3:  # wood: growth rings along x, and its grain
        bend = _noise_at(noise, x * 0.13, y * 0.5, z * 0.5)
        ring = 0.5 + 0.5 * np.sin(2 * np.pi * (y * 0.9 + 3.0 * bend))
        return float(0.65 * ring + 0.35 * _noise_at(noise, x * 0.8, y * 9.0, z * 9.0))
    if texture == 4:  # marble
        coarse = _noise_at(noise, x, y, z)
        veins: float = 0.7 * coarse + 0.5 * _noise_at(noise, x * 2.7 + 5, y * 2.7, z * 2.7)
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
        return 1.0 if joint < 0.012 else 0.35 * tile + 0.15 * _noise_at(noise, x * 6.0, y * 6.0, 0.0)
    return 0.0


@kernel
def _smooth_lit(lit: Float32Array, part: npt.NDArray[np.int32], r: int, c: int) -> float:  # pragma: no cover (compiled)
    """Return a pixel's lamp fraction, interpolated from neighbours with a value on the same part."""
    total, weight = 0.0, 1e-6
    for i in range((r - 1) // 2, (r + 1) // 2 + 1):
        for j in range((c - 1) // 2, (c + 1) // 2 + 1):
            if 0 <= i < lit.shape[0] and 0 <= j < lit.shape[1]:
                near = 1.0 if part[2 * i, 2 * j] == part[r, c] else 1e-5
                total += near * lit[i, j]
                weight += near
    return total / weight


@kernel
def _places(
    depth_m: Float32Array,
    face: npt.NDArray[np.int32],
    u: Float32Array,
    v: Float32Array,
    rays: Float32Array,
    eye: Float32Array,
    corner_normals: Float32Array,
    points: Float32Array,
    normals: Float32Array,
    cosine: Float32Array,
) -> None:  # pragma: no cover (compiled)
    """Fill each pixel's surface point (H, W, 3), its normal towards the camera, and its ray's cosine."""
    for r in range(depth_m.shape[0]):
        for c in range(depth_m.shape[1]):
            f, z = face[r, c], depth_m[r, c]
            x, y, h = rays[r, c, 0], rays[r, c, 1], rays[r, c, 2]
            points[r, c, 0], points[r, c, 1], points[r, c, 2] = eye[0] + x * z, eye[1] + y * z, eye[2] + h * z
            if f < 0:
                normals[r, c, :] = 0.0
                cosine[r, c] = 0.0
                continue
            a, b = u[r, c], v[r, c]
            n = corner_normals[f]
            nx = (1 - a - b) * n[0, 0] + a * n[1, 0] + b * n[2, 0]
            ny = (1 - a - b) * n[0, 1] + a * n[1, 1] + b * n[2, 1]
            nz = (1 - a - b) * n[0, 2] + a * n[1, 2] + b * n[2, 2]
            along = nx * x + ny * y + nz * h
            length = np.sqrt(nx * nx + ny * ny + nz * nz) * (-1.0 if along > 0 else 1.0)
            normals[r, c, 0], normals[r, c, 1], normals[r, c, 2] = nx / length, ny / length, nz / length
            cosine[r, c] = -along / length / np.sqrt(x * x + y * y + h * h)


@kernel
def _colors(
    part: npt.NDArray[np.int32],
    points: Float32Array,
    normals: Float32Array,
    eye: Float32Array,
    parts: Float64Array,
    lamp: Float64Array,
    lit: Float32Array,
    noise: Float32Array,
    gamma: UInt8Array,
    color: UInt8Array,
) -> None:  # pragma: no cover (compiled)
    """Fill `color` (H, W, 3) from the output of `_places` and the tables of `ShadingParameters`."""
    for r in range(part.shape[0]):
        for c in range(part.shape[1]):
            if part[r, c] < 0:
                color[r, c, :] = 30
                continue
            look = parts[part[r, c]]
            px, py, pz = points[r, c, 0], points[r, c, 1], points[r, c, 2]
            nx, ny, nz = normals[r, c, 0], normals[r, c, 1], normals[r, c, 2]
            x = look[9] * px + look[10] * py + look[11] * pz + look[12]
            y = look[13] * px + look[14] * py + look[15] * pz + look[16]
            z = look[17] * px + look[18] * py + look[19] * pz + look[20]
            fraction = _second_fraction(noise, int(look[6]), x / look[7], y / look[7], z / look[7])
            fine = 0.94 + 0.12 * _noise_at(noise, x / FINE_M, y / FINE_M, z / FINE_M)
            lx, ly, lz = lamp[0] - px, lamp[1] - py, lamp[2] - pz
            far = np.sqrt(lx * lx + ly * ly + lz * lz)
            lx, ly, lz = lx / far, ly / far, lz / far
            sees = _smooth_lit(lit, part, r, c)
            direct = sees * max(nx * lx + ny * ly + nz * lz, 0.0) * min(LAMP / (far * far), LAMP_MOST)
            lifted = 0.5 + 0.5 * nz
            light = direct + AMBIENT_DOWN + (AMBIENT_UP - AMBIENT_DOWN) * lifted
            ex, ey, ez = eye[0] - px, eye[1] - py, eye[2] - pz
            length = np.sqrt(ex * ex + ey * ey + ez * ez)
            hx, hy, hz = lx + ex / length, ly + ey / length, lz + ez / length
            half = max(nx * hx + ny * hy + nz * hz, 0.0) / np.sqrt(hx * hx + hy * hy + hz * hz + 1e-12)
            half *= half
            gloss = look[8] * sees * GLOSS * half**20 if half > 0.5 else 0.0
            for k in range(3):
                amount = (look[k] * (1 - fraction) + look[3 + k] * fraction) * fine * light + gloss
                color[r, c, k] = gamma[int(min(max(amount, 0.0), 1.0) * 4095)]
