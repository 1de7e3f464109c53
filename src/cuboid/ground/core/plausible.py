"""Whether the median depth of a recording is plausible for its depth scale, and its focal length for a camera."""

from __future__ import annotations

import math

from cuboid.ground.core.frame import Intrinsics

# Usual fields of view along the longer side, degrees: industrial depth cameras have 30 and more, the Azure Kinect 120.
NARROWEST_DEG, WIDEST_DEG = 25.0, 140.0
# Plausible range of the median depth of a room or a table, metres; real recordings at hand have 0.44 to 2.2.
NEAREST_MEDIAN_M, FARTHEST_MEDIAN_M = 0.2, 8.0


def is_plausible(median_m: float) -> bool:
    """Return whether a room or a table can have this median depth."""
    return NEAREST_MEDIAN_M <= median_m <= FARTHEST_MEDIAN_M


def scale_warning(median_m: float, units: float) -> str | None:
    """Return a one-line warning with a likely depth scale if the median depth is not plausible, else None.

    Parameters
    ----------
    median_m : float
        Median depth, metres.
    units : float
        Depth units per metre in use.
    """
    if is_plausible(median_m):
        return None
    likely = units * (10 if median_m > FARTHEST_MEDIAN_M else 0.1)
    return (
        f"the depth scale of {units:g} units per metre is probably wrong: the median depth is {median_m:.2g} m; "
        f"at --depth-scale {likely:g} it is {median_m * units / likely:.2g} m"
    )


def field_of_view_warning(intrinsics: Intrinsics) -> str | None:
    """Return a one-line warning about a focal length that hardly any depth camera has, else None.

    It needs no frames: in a short run, frames overlap too little to check the intrinsics.
    """
    K = intrinsics
    longer, focal = (K.width, K.fx) if K.width >= K.height else (K.height, K.fy)
    angle_deg = 2.0 * math.degrees(math.atan(longer / 2.0 / focal))
    if NARROWEST_DEG <= angle_deg <= WIDEST_DEG:
        return None
    return (
        f"the focal length in use, {focal:.1f} px, means a field of view of {angle_deg:.0f} degrees along {longer} "
        "pixels; depth cameras have 40 to 120: is it for another image size? 'cuboid calibrate' finds the intrinsics"
    )
