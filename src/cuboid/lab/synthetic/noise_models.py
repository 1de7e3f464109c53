"""Published noise models of depth cameras.

==================  ==============================================================================
`structured-light`  Kinect v1. Deviation and step of depth: Khoshelham and Oude Elberink, "Accuracy
                    and Resolution of Kinect Depth Data", Sensors 12 (2012). Ragged edges and slanted
                    surfaces: Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise for Improved 3D
                    Reconstruction and Tracking", 3DIMPVT (2012).
`time-of-flight`    Kinect v2. Deviation by distance and angle: Fankhauser et al., "Kinect v2 for Mobile
                    Robot Navigation: Evaluation and Modeling", ICAR (2015).
`clean`             The depth of the geometry.
==================  ==============================================================================
"""

from __future__ import annotations

import cv2
import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M
from cuboid.lab.synthetic.sensor_effects import (
    CROSS,
    EDGE_HOLES,
    STRAY_HOLES,
    Seen,
    edges,
    filled,
    grazing,
    incidence,
    projector_shadow,
    ragged,
    window_noise,
    within,
)

# Khoshelham: depth deviates by half a step of disparity, and one step is 2.85e-5 / cm of inverse depth. Rounding to
# steps contributes 1/sqrt(12) of a step; noise before rounding contributes the rest.
STEP_PER_M = 2.0 * DEPTH_NOISE_PER_M
NOISE_STEPS = float(np.sqrt(0.5**2 - 1 / 12))
# Nguyen: beyond 60 degrees depth deviates by 0.0001 / sqrt(z) t^2 / (pi/2 - t)^2 metres more.
SLANT_M = 1e-4
# Distance between projector and camera, and depth range (Kinect v1), metres.
BASELINE_M = 0.075
STRUCTURED_LIGHT_RANGE_M = (0.45, 5.0)
# Depth range of Kinect v2, metres.
TIME_OF_FLIGHT_RANGE_M = (0.5, 4.5)
CLEAN_RANGE_M = (0.05, 12.0)


def structured_light(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return depth as Kinect v1 would measure it, (H, W) float32, 0 for no reading.

    Parameters
    ----------
    seen : Seen
    intrinsics : Intrinsics
    rng : numpy.random.Generator
    """
    angle, slant = incidence(seen.cosine)
    edge = edges(seen.depth_m)
    depth = ragged(seen.depth_m, edge, slant, rng)
    z = np.maximum(depth, np.float32(1e-3))
    steps = window_noise(depth.shape, rng) * np.float32(NOISE_STEPS)
    steep = np.where(angle > np.radians(60), np.float32(SLANT_M) / np.sqrt(z) * slant * slant, np.float32(0))
    extra = rng.standard_normal(depth.shape, np.float32) * np.minimum(steep, np.float32(0.05))
    inverse = 1 / (z + extra).clip(0.05) + np.float32(STEP_PER_M) * steps
    measured = 1 / (np.maximum(np.rint(inverse / np.float32(STEP_PER_M)), 1) * np.float32(STEP_PER_M))
    shadow = np.zeros(depth.shape, np.bool_)
    projector_shadow(seen.depth_m, intrinsics.fx * BASELINE_M, shadow)
    draw = rng.random(depth.shape, np.float32)
    lost = shadow | (edge & (draw < EDGE_HOLES)) | (draw < STRAY_HOLES) | grazing(angle, draw)
    return within(measured, depth, lost, STRUCTURED_LIGHT_RANGE_M)


def time_of_flight(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return depth as Kinect v2 would measure it; arguments as for `structured_light`.

    At edges some pixels get light from both surfaces and read a depth between the two (flying pixels).
    """
    angle, slant = incidence(seen.cosine)
    z = seen.depth_m
    deviation_mm = 1.5 - 0.5 * z + 0.3 * z * z + 0.1 * z * np.sqrt(z) * slant * slant
    noise = rng.standard_normal(z.shape, np.float32) * np.minimum(deviation_mm, 50).astype(np.float32) / 1000
    edge = edges(z)
    near, far = cv2.erode(filled(z), CROSS), cv2.dilate(filled(z), CROSS)
    draw = rng.random(z.shape, np.float32)
    fraction = rng.random(z.shape, np.float32)
    mixed = np.where(edge & (draw > 0.5), fraction * near + (1 - fraction) * np.minimum(far, z + 1), z)
    lost = (draw < STRAY_HOLES) | grazing(angle, draw)
    return within(mixed + noise, z, lost, TIME_OF_FLIGHT_RANGE_M)


def clean(seen: Seen, intrinsics: Intrinsics, rng: np.random.Generator) -> Float32Array:
    """Return the true depth, up to 12 m."""
    return within(seen.depth_m, seen.depth_m, np.zeros(seen.depth_m.shape, np.bool_), CLEAN_RANGE_M)
