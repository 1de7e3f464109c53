"""From hits to a color image: Lambert's law under a lamp and a bright sky, with textures by position.

The lamp is a few points, so that shadows have soft edges; shadow rays are cast for every second pixel of
every second row, and spread over neighbours on the same part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from cuboid.frame import Float32Array, Float64Array, Intrinsics, UInt8Array
from cuboid.synthetic.material import Material, linear
from cuboid.synthetic.raycast import SHADOW_BIAS_M, Hits, RayCaster, pixel_rays

# Light from everywhere, at a surface that looks down and at one that looks up; the rest is the lamp's.
AMBIENT_DOWN, AMBIENT_UP = 0.16, 0.34
LAMP = 0.78
# The blur of a small lens, pixels; it also softens the steps of one ray a pixel.
BLUR_PX = 0.55
# Noise of the color sensor, grey levels.
COLOR_NOISE = 1.6

_NOISE_CELLS = 32
_NOISE = np.random.default_rng(20).random((_NOISE_CELLS,) * 3, np.float32)
_GAMMA = (np.clip(np.linspace(0.0, 1.0, 1024), 0, 1) ** (1 / 2.2) * 255).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Look:
    """What the shading knows of a scene's surfaces.

    Attributes
    ----------
    face_part : (F,) int32
    normals : (F, 3, 3) float32
        Of each face's corners, in the world.
    parts : (P, 21) float64
        color, second (linear), texture, scale, shine, T_body_world (3 x 4, by rows).
    lamp : (L, 3) float64
        Points of the lamp, in the world.
    up : (3,) float64
    """

    face_part: npt.NDArray[np.int32]
    normals: Float32Array
    parts: Float64Array
    lamp: Float64Array
    up: Float64Array


def part_rows(materials: Sequence[Material], T_body_world: Sequence[Float64Array]) -> Float64Array:
    """Return the table `Look.parts`."""
    rows = np.empty((len(materials), 21))
    for row, look, T in zip(rows, materials, T_body_world, strict=True):
        row[0:3], row[3:6] = linear(look.color), linear(look.second)
        row[6:9] = look.texture, look.scale_m, look.shine
        row[9:] = T[:3].reshape(-1)
    return rows


def shade(
    caster: RayCaster,
    look: Look,
    hits: Hits,
    intrinsics: Intrinsics,
    T_world_camera: Float64Array,
    rng: np.random.Generator,
) -> tuple[UInt8Array, Float32Array]:
    """Return the color image (H, W, 3) RGB, and the cosine between each pixel's ray and its surface (H, W)."""
    height, width = hits.depth_m.shape
    rays = pixel_rays(intrinsics)
    lit = _lit_share(caster, look, hits, rays, T_world_camera)
    color = np.empty((height, width, 3), np.float32)
    cosine = np.empty((height, width), np.float32)
    arrays = (hits.depth_m, hits.face, hits.u, hits.v, rays, np.ascontiguousarray(T_world_camera))
    _shade_pixels(
        *arrays, look.face_part, look.normals, look.parts, look.lamp, look.up, lit, _NOISE, color, cosine
    )
    color = cv2.GaussianBlur(color, (0, 0), BLUR_PX)
    seen = _GAMMA[np.clip(color * 1023, 0, 1023).astype(np.int32)]
    noise = rng.standard_normal((height, width), np.float32) * np.float32(COLOR_NOISE)
    return np.clip(seen + noise[..., None] + 0.5, 0, 255).astype(np.uint8), cosine


def _lit_share(
    caster: RayCaster, look: Look, hits: Hits, rays: Float32Array, T_world_camera: Float64Array
) -> Float32Array:
    """Return the share of the lamp that each second pixel sees, (ceil(H/2), ceil(W/2))."""
    depth, face = hits.depth_m[::2, ::2], hits.face[::2, ::2]
    normal = look.normals[face].mean(axis=2)
    toward_camera = rays[::2, ::2] @ -T_world_camera[:3, :3].T.astype(np.float32)
    facing = np.sign(np.einsum("hwk,hwk->hw", normal, toward_camera))
    points = (rays[::2, ::2] * depth[..., None]) @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    points = points + normal * (SHADOW_BIAS_M * facing)[..., None]
    flat = np.ascontiguousarray(points.reshape(-1, 3), np.float32)
    lit = np.zeros(len(flat), np.float32)
    for point in look.lamp:
        lit += caster.reaches(flat, point)
    return (lit / np.float32(len(look.lamp))).reshape(depth.shape)


@njit(cache=True, nogil=True)
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
    return low * (1 - c) + high * c


@njit(cache=True, nogil=True)
def _cell(noise: Float32Array, x: float, y: float, z: float) -> float:  # pragma: no cover (compiled)
    """Return a number 0..1 that is one for each cell of the unit lattice."""
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    return noise[(i * 7 + j * 3) & 31, (j * 11 + k * 5) & 31, (k * 13 + i) & 31]


@njit(cache=True, nogil=True)
def _second_share(
    noise: Float32Array, texture: int, x: float, y: float, z: float
) -> float:  # pragma: no cover (compiled)
    """Return the share of the second color at a place in units of the texture's scale, 0..1."""
    if texture == 1:  # checker
        even = int(np.floor(x + 0.37)) + int(np.floor(y + 0.37)) + int(np.floor(z + 0.37))
        return float(even & 1)
    if texture == 2:  # stripes
        return min(max(0.5 + 3.0 * np.sin(2 * np.pi * (0.5 * x + 0.3 * y + z)), 0.0), 1.0)
    if texture == 3:  # wood: growth rings along x, and its grain
        bend = _noise_at(noise, x * 0.13, y * 0.5, z * 0.5)
        ring = 0.5 + 0.5 * np.sin(2 * np.pi * (y * 0.9 + 3.0 * bend))
        return 0.65 * ring + 0.35 * _noise_at(noise, x * 0.8, y * 9.0, z * 9.0)
    if texture == 4:  # marble
        coarse = _noise_at(noise, x, y, z)
        return min(max(0.7 * coarse + 0.5 * _noise_at(noise, x * 2.7 + 5, y * 2.7, z * 2.7) - 0.1, 0.0), 1.0)
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


@njit(cache=True, nogil=True)
def _smooth_lit(
    lit: Float32Array, face: npt.NDArray[np.int32], face_part: npt.NDArray[np.int32], r: int, c: int
) -> float:  # pragma: no cover (compiled)
    """Spread the lamp's share from the pixels that have it to their neighbours on the same part."""
    part = face_part[face[r, c]]
    total, weight = 0.0, 1e-6
    for i in range((r - 1) // 2, (r + 1) // 2 + 1):
        for j in range((c - 1) // 2, (c + 1) // 2 + 1):
            if 0 <= i < lit.shape[0] and 0 <= j < lit.shape[1]:
                other = face[2 * i, 2 * j]
                near = 1.0 if other >= 0 and face_part[other] == part else 1e-5
                total += near * lit[i, j]
                weight += near
    return total / weight


@njit(cache=True, nogil=True)
def _shade_pixels(depth, face, u, v, rays, T, face_part, normals, parts, lamp, up, lit, noise, color, cosine):  # type: ignore[no-untyped-def]  # pragma: no cover (compiled)
    """Fill `color` (linear light) and `cosine`; the arguments are those of `Hits`, `Look` and `shade`."""
    lamp_middle = lamp.sum(axis=0) / lamp.shape[0]
    for r in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            f = face[r, c]
            if f < 0:
                color[r, c, :] = 0.02
                cosine[r, c] = 0.0
                continue
            z = depth[r, c]
            ray = T[:3, :3] @ rays[r, c].astype(np.float64)
            place = T[:3, 3] + ray * z
            a, b = u[r, c], v[r, c]
            n = ((1 - a - b) * normals[f, 0] + a * normals[f, 1] + b * normals[f, 2]).astype(np.float64)
            n /= np.sqrt(n @ n) + 1e-12
            ray /= np.sqrt(ray @ ray)
            facing = -(n @ ray)
            if facing < 0:
                n, facing = -n, -facing
            cosine[r, c] = facing
            row = parts[face_part[f]]
            scale = row[7]
            x = (row[9] * place[0] + row[10] * place[1] + row[11] * place[2] + row[12]) / scale
            y = (row[13] * place[0] + row[14] * place[1] + row[15] * place[2] + row[16]) / scale
            h = (row[17] * place[0] + row[18] * place[1] + row[19] * place[2] + row[20]) / scale
            share = _second_share(noise, int(row[6]), x, y, h)
            fine = 0.94 + 0.12 * _noise_at(noise, x * scale / 0.012, y * scale / 0.012, h * scale / 0.012)
            to_lamp = lamp_middle - place
            far = np.sqrt(to_lamp @ to_lamp)
            to_lamp /= far
            sees = _smooth_lit(lit, face, face_part, r, c)
            direct = LAMP * sees * max(n @ to_lamp, 0.0) * min(5.5 / (far * far), 1.6)
            light = direct + AMBIENT_DOWN + (AMBIENT_UP - AMBIENT_DOWN) * (0.5 + 0.5 * (n @ up))
            half = to_lamp - ray
            half /= np.sqrt(half @ half) + 1e-12
            gloss = row[8] * sees * 0.55 * max(n @ half, 0.0) ** 40
            for k in range(3):
                albedo = (row[k] * (1 - share) + row[3 + k] * share) * fine
                color[r, c, k] = albedo * light + gloss
