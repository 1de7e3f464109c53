"""Depth cameras with what the published noise models lack: holes by material, bleeding edges, blobs, misregistration.

==================  ==============================================================================
`kinect-v1`         The model `structured-light`; in addition no readings where too little of the pattern comes back
                    (dark, slanted, far surfaces) and where it is mirrored, none in the last 8 columns (window of
                    the correlation), and depth that is displaced against color. Holes by material: Mallick, Das,
                    Majumdar, "Characterizations of Noise in Kinect Depth Images: A Review", IEEE Sensors Journal 14
                    (2014).
`realsense-d435`    Active stereo. Deviation z^2 * subpixel / (focal length * baseline): Grunnet-Jepsen, Sweetser,
                    Woodfill, "Best-Known-Methods for Tuning Intel RealSense D400 Depth Cameras" (2018), which also
                    names the band without readings at the left. Noise and edges are those of a matching window.
`azure-kinect`      Time of flight. Deviation up to 17 mm, flying pixels, dark and shiny surfaces: Tolgyessy et al.,
                    "Evaluation of the Azure Kinect and Its Comparison to Kinect V1 and Kinect V2", Sensors 21
                    (2021). Invalid pixels (weak signal, saturation, edges): Microsoft, "Azure Kinect DK depth camera".
`iphone-lidar`      Depth images of 256 x 192, without holes and with soft edges, which the phone makes from its LiDAR
                    and color: Apple, "ARFrame.sceneDepth". Error of about 1 cm: Luetzenburg, Kroon, Bjork, "Evaluation
                    of the Apple iPhone 12 Pro LiDAR for an Application in Geosciences", Scientific Reports 11 (2021).
==================  ==============================================================================

Limits of the signal are relative to a white wall that faces the camera at 1 m; they are chosen so that black things
have holes from 1 to 1.5 m on and grey things have none up to 3 m.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.lab.synthetic.noise_models import structured_light
from cuboid.lab.synthetic.sensor_effects import Mask, Seen, edges, filled, grazing, incidence, projector_shadow, within

# Signal below which half of the readings are lost.
KINECT_SIGNAL, D435_SIGNAL, AZURE_SIGNAL = 0.018, 0.012, 0.012
# Fraction of infrared light that also black surfaces reflect.
LEAST_REFLECTED = np.float32(0.02)
# Relative deviation of that limit between blobs.
BLOB_DEVIATION = 0.6
# A mirroring surface (highlight at least this strong) that faces the camera within this angle blinds the sensor.
SHINY, MIRRORED_DEG = 0.45, 14.0
# Columns at the right without readings, and displacement of depth (right, down) against color: pixels at a width of
# 640.
KINECT_COLUMNS, KINECT_DISPLACED = 8, (2, 1)
# D435: baseline, metres; focal length at a width of 848, pixels; deviation and step of disparity, pixels.
D435_BASELINE_M, D435_FOCAL_PX, D435_SUBPIXEL, D435_STEP = 0.05, 447.0, 0.08, 1 / 32
D435_RANGE_M = (0.2, 8.0)
# Deviation of the window of its matching, and maximum width by which near surfaces grow, pixels at a width of 640.
MATCHING_PX, MAX_GROWTH_PX = 2.5, 3
# Weight of the contrast of color for a match, beside the signal of the projected pattern.
CONTRAST_WEIGHT = 0.4
# Azure Kinect, narrow field of view: deviation at a white wall in 1 m and its maximum, metres; distance of the color
# camera, metres; signal that saturates.
AZURE_DEVIATION_M, AZURE_MOST_M, AZURE_COLOR_M, AZURE_SATURATED = 0.0009, 0.017, 0.032, 2.2
AZURE_RANGE_M = (0.25, 3.86)
# Fraction of pixels at an edge that the Azure Kinect marks as invalid; the others fly.
AZURE_EDGE_HOLES = 0.6
# iPhone: width of its depth images, pixels; deviation of its smoothing, pixels of these images; deviation of the
# error that is alike over 8 of these pixels, metres and fraction of the depth.
PHONE_WIDTH, PHONE_BLUR_PX, PHONE_CORRELATED_PX = 256, 0.9, 8.0
PHONE_ERROR_M, PHONE_ERROR_FRACTION = 0.002, 0.003
PHONE_RANGE_M = (0.1, 5.0)
# Unit of depth of all but the iPhone, metres.
UNIT_M = np.float32(0.001)


def kinect_v1(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return depth as a Kinect v1 measures it in a home, (H, W) float32, 0 for no reading."""
    measured = structured_light(seen, intrinsics, rng)
    lost = _weak(seen, KINECT_SIGNAL, intrinsics, rng) | _mirroring(seen, intrinsics, rng)
    measured[lost] = 0
    scale = intrinsics.width / 640
    measured[:, intrinsics.width - round(KINECT_COLUMNS * scale) :] = 0
    right, down = (round(px * scale) for px in KINECT_DISPLACED)
    displaced = np.zeros_like(measured)
    displaced[down:, right:] = measured[: len(measured) - down, : intrinsics.width - right]
    return displaced


def realsense_d435(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return depth as a RealSense D435 measures it; arguments as for `kinect_v1`."""
    scale = intrinsics.width / 640
    angle, _ = incidence(seen.cosine)
    depth = _grown(seen.depth_m, max(1, round(MAX_GROWTH_PX * scale)), rng)
    noise = _blobs(depth.shape, MATCHING_PX * scale, rng) * np.float32(D435_SUBPIXEL)
    disparity = np.float32(D435_FOCAL_PX * D435_BASELINE_M) / np.maximum(depth, np.float32(0.05)) + noise
    disparity = np.maximum(np.rint(disparity / np.float32(D435_STEP)), 1) * np.float32(D435_STEP)
    measured = np.float32(D435_FOCAL_PX * D435_BASELINE_M) / disparity
    shadow = np.zeros(depth.shape, np.bool_)
    projector_shadow(seen.depth_m, intrinsics.fx * D435_BASELINE_M, shadow)
    # The band at the left that only one of its cameras sees.
    shadow |= np.arange(depth.shape[1]) < intrinsics.fx * D435_BASELINE_M / filled(depth)
    mean = cv2.blur(seen.albedo, (7, 7))
    contrast = np.sqrt(np.maximum(cv2.blur(seen.albedo * seen.albedo, (7, 7)) - mean * mean, 0))
    weak = _weak(seen, D435_SIGNAL, intrinsics, rng, np.float32(CONTRAST_WEIGHT) * contrast)
    lost = shadow | weak | _mirroring(seen, intrinsics, rng) | grazing(angle, rng.random(depth.shape, np.float32))
    return within(_in_units(measured), depth, lost, D435_RANGE_M)


def azure_kinect(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return depth as an Azure Kinect measures it, in the image of its color camera; arguments as for `kinect_v1`."""
    z = seen.depth_m
    signal = _signal(seen)
    deviation = np.minimum(np.float32(AZURE_DEVIATION_M) / np.sqrt(np.maximum(signal, np.float32(1e-4))), AZURE_MOST_M)
    noise = rng.standard_normal(z.shape, np.float32) * deviation
    edge = cv2.dilate(edges(z).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    mixed = np.where(edge & (z > 0), cv2.blur(np.minimum(filled(z), z + 1), (5, 5)), z)
    shadow = np.zeros(z.shape, np.bool_)
    projector_shadow(z, intrinsics.fx * AZURE_COLOR_M, shadow)
    saturated = (signal > AZURE_SATURATED) & (seen.shine > SHINY)
    lost = shadow | saturated | (edge & (rng.random(z.shape, np.float32) < AZURE_EDGE_HOLES))
    lost |= _weak(seen, AZURE_SIGNAL, intrinsics, rng) | _mirroring(seen, intrinsics, rng)
    return within(_in_units(mixed + noise), z, lost, AZURE_RANGE_M)


def iphone_lidar(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return depth as ARKit gives it, enlarged to the size of the color image; arguments as for `kinect_v1`."""
    height, width = seen.depth_m.shape
    small_width = min(PHONE_WIDTH, width)
    small = cv2.resize(
        np.minimum(filled(seen.depth_m), np.float32(PHONE_RANGE_M[1] + 1)),
        (small_width, max(1, round(height * small_width / width))),
        interpolation=cv2.INTER_AREA,
    )
    small = cv2.GaussianBlur(small, (0, 0), PHONE_BLUR_PX)
    error = _blobs(small.shape, PHONE_CORRELATED_PX, rng)
    small += error * (np.float32(PHONE_ERROR_M) + np.float32(PHONE_ERROR_FRACTION) * small)
    measured = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
    return within(measured, measured, np.zeros(measured.shape, np.bool_), PHONE_RANGE_M)


def _signal(seen: Seen) -> Float32Array:
    """Return the light that comes back from the sensor's own lamp: 1 from a white wall at 1 m."""
    reflected = LEAST_REFLECTED + seen.albedo
    signal: Float32Array = reflected * seen.cosine / np.maximum(seen.depth_m, np.float32(0.2)) ** 2
    return signal


def _weak(
    seen: Seen, limit: float, intrinsics: Intrinsics, rng: np.random.Generator, more: Float32Array | float = 0.0
) -> Mask:
    """Return pixels whose signal, plus `more`, is below a limit that differs between blobs."""
    blob = _blobs(seen.depth_m.shape, 3.0 * intrinsics.width / 640, rng)
    limits = np.float32(limit) * np.maximum(1 + np.float32(BLOB_DEVIATION) * blob, np.float32(0.1))
    weak: Mask = _signal(seen) + more < limits
    return weak


def _mirroring(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Mask:
    """Return blobs on shiny surfaces that face the sensor, whose lamp they mirror."""
    angle, _ = incidence(seen.cosine)
    blob = _blobs(seen.depth_m.shape, 2.0 * intrinsics.width / 640, rng)
    mirrored: Mask = (seen.shine > SHINY) & (angle + np.float32(0.06) * blob < np.radians(MIRRORED_DEG))
    return mirrored & (seen.depth_m > 0)


def _grown(depth_m: Float32Array, most_px: int, rng: np.random.Generator) -> Float32Array:
    """Return depth whose near surfaces grow by up to `most_px` pixels, with a ragged outline."""
    depth, amount = filled(depth_m), _blobs(depth_m.shape, 2.0, rng)
    grown = depth_m
    for px in range(1, most_px + 1):
        near = np.asarray(cv2.erode(depth, np.ones((2 * px + 1, 2 * px + 1), np.uint8)), np.float32)
        reached = (amount > px - 1.5) & (depth - near > np.float32(0.02) * near + np.float32(0.01))
        grown = np.where(reached & (depth_m > 0) & _not_slanted(depth, near, px), near, grown)
    return grown


def _not_slanted(depth: Float32Array, near: Float32Array, px: int) -> Mask:
    """Tell where the depth jumps within `px` pixels: a slanted surface changes evenly to both sides."""
    far = cv2.dilate(depth, np.ones((2 * px + 1, 2 * px + 1), np.uint8))
    jumps: Mask = (depth - near) > 3 * np.maximum(far - depth, np.float32(1e-3))
    return jumps


def _blobs(shape: tuple[int, ...], deviation_px: float, rng: np.random.Generator) -> Float32Array:
    """Return noise (H, W) of deviation 1 that is alike over a few pixels."""
    step = max(1, int(deviation_px))
    coarse = rng.standard_normal((shape[0] // step + 2, shape[1] // step + 2), np.float32)
    smooth = cv2.GaussianBlur(coarse, (0, 0), 0.8)
    blobs = np.asarray(cv2.resize(smooth, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR), np.float32)
    deviation = max(float(blobs.std()), 1e-6)
    return blobs / np.float32(deviation)


def _in_units(depth_m: npt.NDArray[np.floating[Any]]) -> Float32Array:
    return np.asarray(np.rint(depth_m / UNIT_M) * UNIT_M, np.float32)
