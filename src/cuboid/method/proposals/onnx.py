"""Proposals by a user's detector or mask model in an ONNX file; its classes are ignored.

`cuboid.method.detection` reads the model and defines the supported output layouts.
"""

from __future__ import annotations

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.onnx import onnx_detector
from cuboid.method.detection.types import Detector
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import Proposals, ProposalSource


class OnnxModel:
    """Proposes the boxes or masks that a detector or mask model finds.

    Parameters
    ----------
    detector : Detector
    """

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first.

        Raises
        ------
        InputError
            If the model's outputs are of no known kind.
        """
        found = self._detector(frame, intrinsics)
        return Proposals(found.boxes_xyxy, found.best_scores, found.masks)


@SOURCES.register("onnx")
def onnx_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return the model in the ONNX file that `options` names.

    Raises
    ------
    InputError
        If no file is named, or it cannot be used.
    MissingExtraError
        If ONNX Runtime is not installed.
    """
    if not options:
        raise InputError("proposal source 'onnx' needs the file of a model: onnx:MODEL.onnx")
    return OnnxModel(onnx_detector(options, "--proposals onnx"))
