"""Finds the pinhole and the depth scale of a recording in its own frames, and says when those in use are off."""

from __future__ import annotations

from cuboid.calibration.calibrate import CalibrationResult, calibrate, spread_out
from cuboid.calibration.check import Verdict, intrinsics_warning, quick_check
from cuboid.calibration.recording import calibrate_recording

__all__ = [
    "CalibrationResult",
    "Verdict",
    "calibrate",
    "calibrate_recording",
    "intrinsics_warning",
    "quick_check",
    "spread_out",
]
