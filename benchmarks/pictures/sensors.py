"""What depth sensors and cameras make of exact depth and clean color.

The models of the synthetic recordings (`cuboid.lab.synthetic.sensors`), a coarse stereo camera with strong faults, and
holes in displays, glass and polished metal, which those models do not know.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from meshes import DARK, GLASS, SCREEN, SHINY, Rng

from cuboid.ground.core.frame import Intrinsics
from cuboid.lab.synthetic.sensor_effects import Seen
from cuboid.lab.synthetic.sensors import SENSORS

Map = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
# Depth of pixels without any surface, metres: behind everything.
NOTHING_M = 60.0
COARSE_STEREO = "coarse-stereo"
# Weight of each sensor in the draw.
SENSOR_WEIGHTS = {"kinect-v1": 3, "realsense-d435": 2, "azure-kinect": 1.5, "iphone-lidar": 1.5, COARSE_STEREO: 2.5}
# Reflectance of black plastic, and of other materials at least.
BLACK_ALBEDO, LEAST_ALBEDO = 0.03, 0.02
# Chance that holes depend on the material, and how much of the material they cover: 0 nothing, 1 half, 3 nearly all.
HOLES_CHANCE = 0.8
HOLES = {DARK: 0.4, SHINY: 0.7, SCREEN: 1.2, GLASS: 2.5}


@dataclass(frozen=True)
class Exact:
    """A rendered picture: depth in metres (0: nothing), finish of each pixel, RGB from 0 to 255."""

    depth_m: Map
    finish: npt.NDArray[np.uint8]
    color: Map


def draw_sensor(rng: Rng) -> str:
    """Draw the name of a sensor."""
    weights = np.array(list(SENSOR_WEIGHTS.values()))
    return str(rng.choice(list(SENSOR_WEIGHTS), p=weights / weights.sum()))


def measure(exact: Exact, name: str, intrinsics: Intrinsics, rng: Rng) -> Map:
    """Return depth as a sensor reads it, metres, 0 without a reading."""
    cosine = incidence_cosine(exact.depth_m, intrinsics.fx)
    if name == COARSE_STEREO:
        depth = coarse_stereo(exact, cosine, rng)
    else:
        albedo = np.maximum(exact.color.mean(-1) / 255, LEAST_ALBEDO).astype(np.float32)
        albedo[exact.finish == DARK] = BLACK_ALBEDO
        shine = np.isin(exact.finish, (SHINY, SCREEN, GLASS)).astype(np.float32)
        depth = SENSORS[name](Seen(exact.depth_m, cosine, albedo, shine), intrinsics, rng).astype(np.float32)
    if name != "iphone-lidar" and rng.random() < HOLES_CHANCE:
        depth[_material_holes(exact.finish, rng)] = 0
    return depth


def incidence_cosine(depth_m: Map, focal_px: float) -> Map:
    """Return the cosine of the angle between surface and ray, from the gradient of the depth."""
    z = np.where(depth_m > 0, depth_m, NOTHING_M).astype(np.float32)
    h, w = z.shape
    v, u = np.mgrid[:h, :w].astype(np.float32)
    right, down = (u - w / 2) / focal_px, (v - h / 2) / focal_px
    dzu, dzv = cv2.Sobel(z, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(z, cv2.CV_32F, 0, 1, scale=1 / 8)
    nx, ny, nz = -dzu * focal_px, -dzv * focal_px, z + (u - w / 2) * dzu + (v - h / 2) * dzv
    length = np.sqrt((nx**2 + ny**2 + nz**2) * (right**2 + down**2 + 1))
    return np.asarray(np.abs(nx * right + ny * down + nz) / np.maximum(length, 1e-9), np.float32).clip(0, 1)


def blobs(shape: tuple[int, ...], sigma_px: float, rng: Rng) -> Map:
    """Return smooth noise of mean 0 and deviation 1; wide noise is drawn on a coarser grid."""
    step = max(1, int(sigma_px / 2))
    coarse = rng.standard_normal((shape[0] // step + 2, shape[1] // step + 2), np.float32)
    smooth = cv2.GaussianBlur(coarse, (0, 0), sigma_px / step)
    field = cv2.resize(smooth, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(field / field.std(), np.float32)


def _material_holes(finish: npt.NDArray[np.uint8], rng: Rng) -> Mask:
    """Return holes in blobs on materials that reflect badly."""
    strength = np.zeros(256, np.float32)
    for material, weight in HOLES.items():
        strength[material] = weight * rng.uniform(0, 1.6)
    noise = blobs(finish.shape, 3.0 * rng.uniform(0.6, 4), rng)
    return np.asarray((strength[finish] > 0) & (noise > 1.3 - 1.3 * strength[finish]))


def _edges(z: Map, width_px: int) -> Mask:
    """Return the pixels within a width of a jump in depth of 3 percent."""
    k = np.ones((3, 3), np.uint8)
    band = (cv2.dilate(z, k) - cv2.erode(z, k) > 0.03 * z).astype(np.uint8)
    return np.asarray(cv2.dilate(band, np.ones((2 * width_px - 1,) * 2, np.uint8)) > 0)


def coarse_stereo(exact: Exact, cosine: Map, rng: Rng) -> Map:
    """Return depth of a stereo camera with a wide matching window; how strong each of its faults is differs by picture.

    The near side grows over edges, depth is blurred or mixed at edges, noise is smooth and grows with the square of the
    distance, surfaces without texture have large holes, and holes are filled from the left in one of five pictures.
    """
    z = np.where(exact.depth_m > 0, exact.depth_m, NOTHING_M).astype(np.float32)
    k = 2 * int(rng.integers(1, 5)) + 1
    near = cv2.erode(z, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k)))
    out = np.where(blobs(z.shape, 4.0, rng) > rng.uniform(-1, 0.5), near, z).astype(np.float32)
    smooth = cv2.GaussianBlur(out, (0, 0), float(rng.uniform(0.8, 2.2)))
    mixed = _edges(out, 2) & (rng.random(z.shape) > rng.uniform(0.2, 0.8))
    out = np.where(mixed, out, smooth)
    wave = blobs(z.shape, rng.uniform(2.5, 6), rng) + 0.6 * blobs(z.shape, 1.2, rng) + 0.5 * blobs(z.shape, 30, rng)
    out = out + rng.uniform(0.0008, 0.003) * out**2 * wave
    grey = exact.color.mean(-1)
    contrast = cv2.GaussianBlur(np.abs(grey - cv2.GaussianBlur(grey, (0, 0), 3)), (0, 0), 6)
    lost = (contrast < rng.uniform(0, 1.2)) & (blobs(z.shape, 9, rng) > rng.uniform(0, 2.2))
    lost |= (grey > 250) & (blobs(z.shape, 5, rng) > 0.3)
    lost |= _edges(z, 3) & (blobs(z.shape, 2.5, rng) > rng.uniform(0.2, 1.5))
    lost |= cosine < np.cos(np.radians(rng.uniform(80, 88)))
    lost[:, : int(rng.integers(0, 30))] |= rng.random() < 0.5
    lost |= (out < 0.2) | (out > rng.uniform(5, 10))
    lost = cv2.medianBlur(lost.astype(np.uint8), 5) > 0
    if rng.random() < 0.2:
        source = np.maximum.accumulate(np.where(lost, -1, np.arange(z.shape[1])), axis=1)
        return np.where(source >= 0, np.take_along_axis(out, np.maximum(source, 0), 1), 0).astype(np.float32)
    return np.where(lost, 0, out).astype(np.float32)
