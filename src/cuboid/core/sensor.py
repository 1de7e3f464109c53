"""The depth sensor: how much noisier its first frame shows it to be than it was said to be, and what it resolves."""

from __future__ import annotations

import numpy as np

from cuboid.core.depth import DepthImage
from cuboid.core.kernels.cells import AREA, RMS
from cuboid.core.tolerances import MIN_READINGS

# No more than this is believed, as a multiple of the nominal noise: clutter is no noise.
MAX_EXCESS = 1.4
# At least this fraction of the cells of a picture lie on one flat surface each.
FLAT_FRACTION = 0.2


def excess_noise(image: DepthImage, nominal_per_m: float, max_depth_m: float) -> float:
    """Return the noise that a depth image shows as a multiple of the nominal one, 1..`MAX_EXCESS`.

    Real sensors bow and blob beyond their nominal noise; first Kinects and RealSense cameras show 1.4 times that of
    the first Kinect's published figure over cells of 0.06 radians.

    Parameters
    ----------
    image : DepthImage
    nominal_per_m : float
        1/metre.
    max_depth_m : float
    """
    # As wide as the noise's own blobs.
    cells = image.cells(max_depth_m, 2)
    rms = cells[cells[..., AREA] > 0, RMS]
    if len(rms) < MIN_READINGS:
        return 1.0
    # They show all but that fraction of the noise.
    return float(np.clip(np.quantile(rms, FLAT_FRACTION) / ((1.0 - FLAT_FRACTION) * nominal_per_m), 1.0, MAX_EXCESS))


def resolves_m(edge_m: float, noise_per_m: float, focal_px: float) -> float:
    """Return up to which depth a surface is told in voxels of an edge, metres.

    There the deviation of a reading, or the width of a pixel, is as large as that: means of several are truer.
    """
    return float(min(np.sqrt(edge_m / noise_per_m), edge_m * focal_px))
