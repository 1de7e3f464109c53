"""Frames of a recording in order, decoded ahead in a thread where there is one to spare."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

from cuboid.errors import FrameError
from cuboid.frame import Frame

# How many frames are decoded ahead: enough to keep two cores busy, few enough to bound memory.
DECODED_AHEAD = 2


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


def decode(recording: Readable, indices: range, *, ahead: bool) -> Iterator[Decoded]:
    """Iterate over frames in order.

    Parameters
    ----------
    recording : Readable
    indices : range
        Frames of the recording.
    ahead : bool
        Decode the next frames in a thread while the caller works on this one.

    Yields
    ------
    Decoded
    """

    def read(index: int) -> Decoded:
        start = time.perf_counter()
        try:
            frame, reason = recording.read(index), ""
        except FrameError as error:
            frame, reason = None, str(error)
        return Decoded(index, frame, reason, (time.perf_counter() - start) * 1e3)

    if not ahead:
        yield from map(read, indices)
        return
    pool = ThreadPoolExecutor(1, thread_name_prefix="decode")
    try:
        waiting: deque[Future[Decoded]] = deque()
        for index in indices:
            waiting.append(pool.submit(read, index))
            if len(waiting) > DECODED_AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
