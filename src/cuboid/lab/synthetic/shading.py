"""Shading of hits to a color image: Lambert's law with lamps and ambient light, and textures by position.

A lamp consists of a few points, so that shadows have soft edges. Shadow rays are cast for every second pixel of every
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
from cuboid.lab.synthetic.light import ColorCamera, Light
from cuboid.lab.synthetic.material import Material, linear
from cuboid.lab.synthetic.raycast import SHADOW_BIAS_M, Hits, RayCaster
from cuboid.lab.synthetic.textures import NOISE, fraction_at, noise_at

# Strength of highlights.
GLOSS = 0.55
# Size of the fine texture noise of every surface, metres.
FINE_M = 0.012
# Faces whose normal has a larger vertical component than this have textures along x and y.
LEVEL_NORMAL_Z = 0.7

_GAMMA = np.rint(np.linspace(0.0, 1.0, 4096) ** (1 / 2.2) * 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class ShadingParameters:
    """The surfaces and the light of a scene, as tables for the shading.

    Attributes
    ----------
    face_part : (F,) int32
    normals : (F, 3, 3) float32
        Normals of each face's corners, in the room.
    parts : (P, 30) float64
        color, second (linear), texture, scale, shine, T_body_room (3 x 4, by rows), polish, grain, axis (2), cosine and
        sine of yaw, radius, first layer, one after the last layer.
    layers : (M, 14) float64
        color, second (linear), texture, scale, zone, its extent (4), opacity.
    light : Light
    """

    face_part: npt.NDArray[np.int32]
    normals: Float32Array
    parts: Float64Array
    layers: Float64Array
    light: Light


def part_rows(materials: Sequence[Material], T_body_room: Sequence[Float64Array]) -> tuple[Float64Array, Float64Array]:
    """Return the tables `ShadingParameters.parts` (N, 30) and `.layers` (L, 14) of N poses (4, 4)."""
    rows = np.empty((len(materials), 30))
    layers: list[list[float]] = []
    for row, look, T in zip(rows, materials, T_body_room, strict=True):
        row[0:3], row[3:6] = linear(look.color), linear(look.second)
        row[6:9] = look.texture, look.scale_m, look.shine
        row[9:21] = T[:3].reshape(-1)
        row[21:23] = look.polish, look.grain
        row[23:28] = *look.axis, np.cos(look.yaw_rad), np.sin(look.yaw_rad), look.radius_m
        row[28] = len(layers)
        for layer in look.layers:
            colors = (*linear(layer.color), *linear(layer.second))
            layers.append([*colors, layer.texture, layer.scale_m, layer.zone, *layer.extent, layer.opacity])
        row[29] = len(layers)
    return rows, np.array(layers, np.float64).reshape(-1, 14)


@dataclass(frozen=True, slots=True)
class Shaded:
    """An image of a color camera.

    Attributes
    ----------
    color : (H, W, 3) uint8
        RGB.
    cosine : (H, W) float32
        Cosine of the angle between ray and surface normal.
    albedo : (H, W) float32
        Fraction of the light that the surface reflects, 0..1.
    """

    color: UInt8Array
    cosine: Float32Array
    albedo: Float32Array


def shade(
    caster: RayCaster,
    look: ShadingParameters,
    hits: Hits,
    rng: np.random.Generator,
    camera: ColorCamera,
    frame: int,
) -> Shaded:
    """Return the image of a camera; the exposure depends on the frame."""
    shape = hits.depth_m.shape
    points, normals = np.empty((2, *shape, 3), np.float32)
    cosine, albedo = np.empty((2, *shape), np.float32)
    _places(hits.depth_m, hits.face, hits.u, hits.v, hits.rays, hits.eye, look.normals, points, normals, cosine)
    lamps = look.light.lamps
    lit = np.stack([_lit_fraction(caster, lamp.points, points[::2, ::2], normals[::2, ::2]) for lamp in lamps])
    table = np.array([[*lamp.points.mean(axis=0), *lamp.color, lamp.strength, lamp.max_light] for lamp in lamps])
    ambient = np.array([look.light.down, look.light.up])
    part = np.where(hits.face >= 0, look.face_part[hits.face], np.int32(-1))
    response = np.array([*camera.gain_at(frame), camera.vignetting, camera.saturation])
    tables = look.parts, look.layers, table, ambient, lit, response, NOISE, _GAMMA
    color = np.empty((*shape, 3), np.uint8)
    _colors(part, points, normals, hits.eye, *tables, color, albedo)
    return Shaded(_exposed(color, camera, rng), cosine, albedo)


def _exposed(color: UInt8Array, camera: ColorCamera, rng: np.random.Generator) -> UInt8Array:
    """Return an image with the blur of the lens and the noise of the sensor."""
    shape = color.shape[:2]
    color = cv2.GaussianBlur(color, (0, 0), camera.blur_px).astype(np.uint8, copy=False)
    noise = cv2.merge([rng.standard_normal(shape, np.float32) * np.float32(camera.noise)] * 3)
    if camera.color_noise > 0:
        noise = noise + rng.standard_normal(noise.shape, np.float32) * np.float32(camera.color_noise)
    noisy: UInt8Array = cv2.add(color, noise, dtype=cv2.CV_8U).astype(np.uint8, copy=False)
    return noisy


def _lit_fraction(caster: RayCaster, lamp: Float64Array, points: Float32Array, normals: Float32Array) -> Float32Array:
    """Return the visible fraction of a lamp's points (L, 3) for points (h, w, 3) with normals (h, w, 3)."""
    start = np.ascontiguousarray((points + normals * np.float32(SHADOW_BIAS_M)).reshape(-1, 3))
    lit = np.zeros(len(start), np.float32)
    for point in lamp:
        lit += caster.reaches(start, point)
    return (lit / np.float32(len(lamp))).reshape(points.shape[:2])


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
def _covers(
    layer: Float64Array, u: float, v: float, z: float, nu: float, nv: float, nz: float, s: float, t: float
) -> bool:  # pragma: no cover (compiled)
    """Return whether a layer covers a place at (u, v, z) with normal (nu, nv, nz); s, t as for textures."""
    zone, a, b, c, d = int(layer[8]), layer[9], layer[10], layer[11], layer[12]
    if zone == 0:
        return True
    if zone == 1:
        return bool(a <= z <= b)
    if zone == 2:
        return bool(u * np.cos(a) + v * np.sin(a) > b)
    if zone == 7:
        return bool(u * nu + v * nv < -1e-4 or (nz > LEVEL_NORMAL_Z and z < a))
    if (zone <= 4 and abs(nz) > LEVEL_NORMAL_Z) or (zone > 4 and nz < LEVEL_NORMAL_Z):
        return False
    ds, dt = (s - a) / c, (t - b) / d
    if zone in (3, 5):
        return bool(abs(ds) < 1 and abs(dt) < 1)
    return bool(ds * ds + dt * dt < 1)


@kernel
def _mixed(
    look: Float64Array,
    layers: Float64Array,
    noise: Float32Array,
    place: tuple[float, float, float],
    normal: tuple[float, float, float],
) -> tuple[float, float, float]:  # pragma: no cover (compiled)
    """Return the color (linear) of a part at a place with a normal, both in the body's coordinates."""
    x, y, z = place[0] - look[23], place[1] - look[24], place[2]
    u, v = look[25] * x + look[26] * y, look[25] * y - look[26] * x
    first, last = int(look[28]), int(look[29])
    s, t, nu, nv = u, v, 0.0, 0.0
    if look[6] > 7 or last > first:
        nu = look[25] * normal[0] + look[26] * normal[1]
        nv = look[25] * normal[1] - look[26] * normal[0]
        if abs(normal[2]) <= LEVEL_NORMAL_Z:
            t = z
            s = np.arctan2(v, u) * look[27] if look[27] > 0 else (nu * v - nv * u) / np.sqrt(nu * nu + nv * nv)
    w = look[7]
    f = fraction_at(noise, int(look[6]), u / w, v / w, z / w, s / w, t / w)
    red, green, blue = look[0] * (1 - f) + look[3] * f, look[1] * (1 - f) + look[4] * f, look[2] * (1 - f) + look[5] * f
    for k in range(first, last):
        layer = layers[k]
        if _covers(layer, u, v, z, nu, nv, normal[2], s, t):
            w, o = layer[7], layer[13]
            f = fraction_at(noise, int(layer[6]), u / w, v / w, z / w, s / w, t / w)
            red += o * (layer[0] * (1 - f) + layer[3] * f - red)
            green += o * (layer[1] * (1 - f) + layer[4] * f - green)
            blue += o * (layer[2] * (1 - f) + layer[5] * f - blue)
    return red, green, blue


@kernel
def _colors(
    part: npt.NDArray[np.int32],
    points: Float32Array,
    normals: Float32Array,
    eye: Float32Array,
    parts: Float64Array,
    layers: Float64Array,
    lamps: Float64Array,
    ambient: Float64Array,
    lit: Float32Array,
    response: Float64Array,
    noise: Float32Array,
    gamma: UInt8Array,
    color: UInt8Array,
    albedo: Float32Array,
) -> None:  # pragma: no cover (compiled)
    """Fill `color` (H, W, 3) and `albedo` (H, W) from the output of `_places` and the tables.

    `lamps` (G, 8) has middle, color, strength and maximum of each lamp, `ambient` (2, 3) the light from below and from
    above, `lit` (G, h, w) each lamp's visible fraction, `response` (5,) gain, vignetting and saturation.
    """
    height, width = part.shape
    direct, gloss, amount = np.empty(3), np.empty(3), np.empty(3)
    for r in range(height):
        for c in range(width):
            if part[r, c] < 0:
                color[r, c, :] = 30
                albedo[r, c] = 0.0
                continue
            look = parts[part[r, c]]
            px, py, pz = points[r, c, 0], points[r, c, 1], points[r, c, 2]
            nx, ny, nz = normals[r, c, 0], normals[r, c, 1], normals[r, c, 2]
            x = look[9] * px + look[10] * py + look[11] * pz + look[12]
            y = look[13] * px + look[14] * py + look[15] * pz + look[16]
            z = look[17] * px + look[18] * py + look[19] * pz + look[20]
            nbx = look[9] * nx + look[10] * ny + look[11] * nz
            nby = look[13] * nx + look[14] * ny + look[15] * nz
            nbz = look[17] * nx + look[18] * ny + look[19] * nz
            mix = _mixed(look, layers, noise, (x, y, z), (nbx, nby, nbz))
            fine = 1.0 - 0.5 * look[22] + look[22] * noise_at(noise, x / FINE_M, y / FINE_M, z / FINE_M)
            ex, ey, ez = eye[0] - px, eye[1] - py, eye[2] - pz
            length = np.sqrt(ex * ex + ey * ey + ez * ez)
            direct[:] = 0.0
            gloss[:] = 0.0
            for g in range(len(lamps)):
                lamp = lamps[g]
                sees = _smooth_lit(lit[g], part, r, c)
                lx, ly, lz = lamp[0] - px, lamp[1] - py, lamp[2] - pz
                far = np.sqrt(lx * lx + ly * ly + lz * lz)
                lx, ly, lz = lx / far, ly / far, lz / far
                falls = sees * max(nx * lx + ny * ly + nz * lz, 0.0) * min(lamp[6] / (far * far), lamp[7])
                hx, hy, hz = lx + ex / length, ly + ey / length, lz + ez / length
                half = max(nx * hx + ny * hy + nz * hz, 0.0) / np.sqrt(hx * hx + hy * hy + hz * hz + 1e-12)
                half *= half
                shines = look[8] * sees * GLOSS * half ** int(look[21]) if half > 0.5 else 0.0
                for k in range(3):
                    direct[k] += falls * lamp[3 + k]
                    gloss[k] += shines * lamp[3 + k]
            lifted = 0.5 + 0.5 * nz
            across, down = (2.0 * c - width) / width, (2.0 * r - height) / width
            dims = 1.0 - response[3] * 0.64 * (across * across + down * down)
            for k in range(3):
                light = direct[k] + ambient[0, k] + (ambient[1, k] - ambient[0, k]) * lifted
                amount[k] = (mix[k] * fine * light + gloss[k]) * (response[k] * dims)
            albedo[r, c] = (0.3 * mix[0] + 0.6 * mix[1] + 0.1 * mix[2]) * fine
            grey = 0.3 * amount[0] + 0.6 * amount[1] + 0.1 * amount[2]
            for k in range(3):
                value = amount[k] if response[4] == 1.0 else grey + response[4] * (amount[k] - grey)
                color[r, c, k] = gamma[int(min(max(value, 0.0), 1.0) * 4095)]
