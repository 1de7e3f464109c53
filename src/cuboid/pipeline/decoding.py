"""Frames of a recording in order, each with what decoding it took."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Protocol

from cuboid.core.compiletime import working_s
from cuboid.core.errors import FrameError
from cuboid.core.frame import Frame
from cuboid.readers.prefetch import run_ahead

# How many frames are decoded ahead: enough to keep two cores busy, few enough to bound memory.
FRAMES_AHEAD = 2


class Readable(Protocol):
    """Gives frames by number."""

    def read(self, index: int) -> Frame:
        """Return a frame; raises FrameError for a bad one."""


@dataclass(frozen=True, slots=True)
class Decoded:
    """A frame, or why there is none.

    Attributes
    ----------
    index : int
        Frame of the recording.
    frame : Frame or None
    reason : str
        Why there is no frame; empty where there is one.
    milliseconds : float
        What decoding took, in whichever thread.
    """

    index: int
    frame: Frame | None
    reason: str
    milliseconds: float


def decode(recording: Readable, indices: range, *, ahead: bool) -> Generator[Decoded, None, None]:
    """Iterate over frames in order; close the iterator to end the thread behind it.

    Parameters
    ----------
    recording : Readable
    indices : range
        Frames of the recording.
    ahead : bool
        Decode the next frames in a thread while the caller works on this one.
    """

    def read(index: int) -> Decoded:
        start_s = working_s()
        try:
            frame, reason = recording.read(index), ""
        except FrameError as error:
            frame, reason = None, str(error)
        return Decoded(index, frame, reason, (working_s() - start_s) * 1e3)

    decoded = (read(index) for index in indices)
    return run_ahead(decoded, FRAMES_AHEAD) if ahead else decoded
