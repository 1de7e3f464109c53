"""Proposals by BING (Cheng et al., CVPR 2014): boxes whose small gradient image resembles that of an object.

The user provides the model: a folder with the nine files of OpenCV's samples, three for each of three color spaces::

    MODEL/
      ObjNessB2W8MAXBGR.idx.yml.gz   .wS1.yml.gz   .wS2.yml.gz
      ObjNessB2W8HSV.idx.yml.gz      ...
      ObjNessB2W8I.idx.yml.gz        ...
"""

from __future__ import annotations

import ctypes
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.boxes import thin_out
from cuboid.method.proposals.boxes import boxes_as_proposals
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import Proposals, ProposalSource

_STDOUT = 1
_turn = threading.Lock()


@contextmanager
def silent_stdout() -> Iterator[None]:
    """Discard everything that this process writes to standard output, from native code too.

    The buffers of Python and of C are flushed before and after, so that no earlier or later line is lost.
    """
    import sys

    with _turn:
        _flush(sys.stdout)
        try:
            kept = os.dup(_STDOUT)
        except OSError:  # standard output is closed: nothing to redirect
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, _STDOUT)
            yield
        finally:
            _flush(None)
            os.dup2(kept, _STDOUT)
            os.close(kept)
            os.close(nowhere)


def _flush(stream: object) -> None:
    flush = getattr(stream, "flush", None)
    if flush is not None:
        flush()
    # A null pointer flushes all streams of C.
    ctypes.CDLL(None).fflush(None)


FILES = tuple(f"ObjNessB2W8{space}.{part}.yml.gz" for space in ("MAXBGR", "HSV", "I") for part in ("idx", "wS1", "wS2"))
# OpenCV gives each box a rank, not a score: about 300 for the best and 20,000 for the last. This rank scores 0.5.
HALF_RANK = 3000.0
# BING gives thousands of boxes; only the best of them are used.
BEST_BOXES = 1000
# Boxes that overlap more are duplicates; BING's sizes are powers of two, so that neighbours overlap by half and more.
BING_DUPLICATE_IOU = 0.75


class Bing:
    """Proposes boxes from color with OpenCV's ObjectnessBING.

    OpenCV gives a rank r, the lower the better; the score is 1 / (1 + r / 3000).

    Parameters
    ----------
    model : Path
        Folder of the model.

    Raises
    ------
    InputError
        If a file of the model is missing.
    """

    def __init__(self, model: Path) -> None:
        missing = [name for name in FILES if not (model / name).is_file()]
        if missing:
            raise InputError(f"no BING model in {model}: {missing[0]} is missing")
        self._model = model

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first."""
        import cv2

        finder = cv2.saliency.ObjectnessBING.create()
        # OpenCV prints messages, and writes its boxes to files that are not needed.
        with tempfile.TemporaryDirectory(prefix="cuboid-bing-") as scrap, silent_stdout():
            finder.setTrainingPath(str(self._model))
            finder.setBBResDir(scrap)
            found, boxes = finder.computeSaliency(np.ascontiguousarray(frame.color[..., ::-1]))
            ranks = np.asarray(finder.getobjectnessValues(), dtype=np.float64).ravel()
        if not found:
            raise InputError(f"the BING model in {self._model} cannot be used: OpenCV found no boxes with it")
        # The boxes are sorted, best first. Corners count from 1, and the last corner is inclusive.
        corners = np.asarray(boxes, dtype=np.float64).reshape(-1, 4)[:BEST_BOXES]
        corners[:, :2] -= 1.0
        scores = 1.0 / (1.0 + ranks[: len(corners)] / HALF_RANK)
        kept = thin_out(corners, scores, BING_DUPLICATE_IOU)
        return boxes_as_proposals(corners[kept], scores[kept], intrinsics.width, intrinsics.height)


@SOURCES.register("bing")
def bing_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return BING with the model in the folder that `options` names.

    Raises
    ------
    InputError
        If no folder is named, or it holds no model.
    """
    if not options:
        raise InputError("proposal source 'bing' needs the folder of its model: bing:FOLDER")
    return Bing(Path(options))
