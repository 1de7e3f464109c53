"""Detectors: from a frame to boxes with class scores over a vocabulary; the tracker gets names from them."""

from __future__ import annotations

from cuboid.method.detection import models as _models  # noqa: F401  registers the named models
from cuboid.method.detection.onnx import ENDING, onnx_detector
from cuboid.method.detection.registry import DETECTORS, DetectorFactory
from cuboid.method.detection.types import Detections, Detector

__all__ = ["DETECTORS", "Detections", "Detector", "DetectorFactory", "detector_name", "make_detector"]


def make_detector(spec: str | Detector) -> Detector:
    """Return the detector that `spec` names.

    Parameters
    ----------
    spec : str or Detector
        ``FILE.onnx[:OPTIONS]`` or ``NAME[:OPTIONS]``; any callable from (frame, intrinsics) to `Detections` is
        returned as it is.

    Raises
    ------
    InputError
        No detector has that name, or the model cannot be used.
    MissingExtraError
        The detector needs a package that is not installed.
    """
    if not isinstance(spec, str):
        return spec
    if is_file(spec):
        return onnx_detector(spec)
    name, colon, options = spec.partition(":")
    return DETECTORS.get(name)(options if colon else None)


def is_file(spec: str) -> bool:
    """Tell whether the name of a detector is a file."""
    return spec.lower().endswith(ENDING) or f"{ENDING}:" in spec.lower()


def detector_name(spec: str | Detector) -> str:
    """Return the name in reports of the detector that `make_detector` makes of `spec`."""
    return spec if isinstance(spec, str) else type(spec).__qualname__
