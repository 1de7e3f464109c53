"""Pictures of a video by their number, decoded forward from the last key frame."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import FrameError, InputError


class VideoFile:
    """A video open for reading one picture at a time; in order each is decoded once.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        The video cannot be opened, or contains no pictures.
    """

    def __init__(self, path: Path) -> None:
        import av

        self._path, self._lock = path, threading.Lock()
        try:
            with path.open("rb") as file, av.open(file, "r") as listed:
                packets = [packet for packet in listed.demux(video=0) if packet.pts is not None]
        except Exception as error:  # of ffmpeg, or of what a damaged file holds
            raise InputError(f"{path}: cannot be read as a video: {' '.join(str(error).split())[:120]}") from None
        self._pts = sorted(int(packet.pts) for packet in packets if packet.pts is not None)
        if not self._pts:
            raise InputError(f"{path}: holds no pictures")
        file = path.open("rb")
        self._container: Any = av.open(file, "r")
        self._close = weakref.finalize(self, _close, self._container, file)
        self._frames: Iterator[Any] = iter(())
        self._next = -1  # number of the next picture, -1 if unknown

    def __len__(self) -> int:
        """Return the number of pictures."""
        return len(self._pts)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        stream = self._container.streams.video[0]
        return int(stream.width), int(stream.height)

    def read(self, index: int) -> UInt8Array:
        """Return a picture (H, W, 3) RGB; raises FrameError where it cannot be decoded."""
        if not 0 <= index < len(self._pts):
            raise FrameError(f"{self._path.name} has {len(self._pts)} pictures, none for frame {index}")
        with self._lock:
            try:
                return self._read(self._pts[index], index)
            except FrameError:
                raise
            except Exception as error:  # of ffmpeg
                self._next = -1
                reason = " ".join(str(error).split())[:120]
                raise FrameError(f"picture {index} of {self._path.name} cannot be decoded: {reason}") from None

    def _read(self, pts: int, index: int) -> UInt8Array:
        if index != self._next:
            self._container.seek(pts, stream=self._container.streams.video[0])
            self._frames = self._container.decode(video=0)
        for frame in self._frames:
            if frame.pts is not None and frame.pts >= pts:
                self._next = index + 1
                return np.ascontiguousarray(frame.to_ndarray(format="rgb24"))
        self._next = -1
        with suppress(Exception):
            self._frames.close()  # type: ignore[attr-defined]
        raise FrameError(f"picture {index} is missing from {self._path.name}")


def _close(container: Any, file: BinaryIO) -> None:
    container.close()
    file.close()
