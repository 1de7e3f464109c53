"""Calibration of intrinsics and depth scale from a recording's own frames, and checks of those in use."""

from __future__ import annotations

from cuboid.inputs.calibration.calibrate import CalibrationResult, calibrate, spread_out
from cuboid.inputs.calibration.check import Verdict, intrinsics_warning, quick_check
from cuboid.inputs.calibration.registering import (
    Misregistration,
    find_misregistration,
    register_recording,
    registration_warning,
)

__all__ = [
    "CalibrationResult",
    "Misregistration",
    "Verdict",
    "calibrate",
    "find_misregistration",
    "intrinsics_warning",
    "quick_check",
    "register_recording",
    "registration_warning",
    "spread_out",
]
