"""Encode pictures as a video file: H.264 in MP4 for browsers, or GIF for pages that cannot show MP4."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import cv2
import numpy as np

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import OutputError
from cuboid.results.files.pending import PendingFile
from cuboid.results.views.pixels import shrunk

# Measured at 640x480 on one thread, on labelled frames of a moving camera: superfast takes 3.4 ms and 12 kB per
# frame at this quality, with B frames 4.5 ms and 10 kB; ultrafast takes 2.1 ms and 18 kB. Thin colored lines stay
# clean.
PRESET = "superfast"
QUALITY_CRF = "20"
B_FRAMES = "0"

# Distance between key frames, to which a browser can seek at once: two seconds at 30 frames/s.
KEY_FRAME_EVERY = 60

# Room for the header of an MP4, whose size is about 50 bytes: a block of most file systems.
HEADER_BYTES = 4096

# Code points of ITU-T H.273: BT.601, and the limited range, which all players support. Without them, players assume
# another color matrix for large pictures.
BT601 = 6
LIMITED = 1

# Cb and Cr of R, G, B (ITU-R BT.601, limited range).
CHROMA = np.array([[-0.148223, -0.290993, 0.439216, 128.0], [0.439216, -0.367788, -0.071427, 128.0]])

# A GIF has no motion compensation, and a frame of this size takes about 50 kB. Therefore it is small and short.
GIF_WIDTH_PX = 400
GIF_FRAMES = 100
GIF_FRAMES_PER_SECOND = 12.5
GIF_COLORS = 128
# A fine ordered pattern stays in place from frame to frame; error diffusion does not.
GIF_DITHER = "dither=bayer:bayer_scale=4:diff_mode=rectangle"


class VideoWriter(ABC):
    """Writes pictures in order; the file appears when the writer is closed.

    As a context manager it closes at the end; after an error it leaves no file.
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    @abstractmethod
    def add(self, picture: UInt8Array) -> None:
        """Append a picture.

        Parameters
        ----------
        picture : (H, W, 3) uint8
            RGB; all pictures have the same size.

        Raises
        ------
        OutputError
            The file cannot be written; no file is left.
        """

    @abstractmethod
    def close(self) -> None:
        """Finish the file; without pictures, no file is written.

        Raises
        ------
        OutputError
            The file cannot be written; no file is left.
        """

    @abstractmethod
    def discard(self) -> None:
        """Leave no file."""


class Mp4Writer(VideoWriter):
    """Writes H.264 in MP4, 4:2:0, with the index at the start, so that a browser plays the file while it loads.

    Pictures with an odd side get one more row or column, a copy of the last one. The same pictures give the same
    bytes.

    Parameters
    ----------
    path : Path
        The file; it appears, or is replaced, when `close` is called.
    frames_per_second : float
    """

    def __init__(self, path: Path, frames_per_second: float) -> None:
        self._file = PendingFile(path)
        self._rate = Fraction(frames_per_second).limit_denominator(1001)
        self._container: Any = None
        self._stream: Any = None

    def add(self, picture: UInt8Array) -> None:
        """Append a picture (H, W, 3), RGB; all have one size."""
        height, width = picture.shape[:2]
        if height % 2 or width % 2:
            picture = np.asarray(
                cv2.copyMakeBorder(picture, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE), np.uint8
            )
        try:
            with _encoding(self._file):
                if self._container is None:
                    self._open(picture.shape[1], picture.shape[0])
                self._container.mux(self._stream.encode(av.VideoFrame.from_ndarray(yuv420(picture), format="yuv420p")))
        except OutputError:
            self.discard()  # FFmpeg crashes on further writing if the header could not be written
            raise

    def close(self) -> None:
        """Finish the file; without pictures, no file is written."""
        container, self._container = self._container, None
        if container is None:
            return
        with _encoding(self._file):
            container.mux(self._stream.encode(None))
            container.close()
            self._file.show()

    def discard(self) -> None:
        """Leave no file."""
        container, self._container = self._container, None
        if container is not None:
            with contextlib.suppress(av.FFmpegError, OSError):  # the file is deleted, whatever its state
                container.close()
        self._file.drop()

    def _open(self, width: int, height: int) -> None:
        # If FFmpeg cannot write the header, its file stays open until the process ends, and a full disk in use.
        self._file.partial.write_bytes(bytes(HEADER_BYTES))
        options = {"movflags": "+faststart"}
        self._container = av.open(str(self._file.partial), "w", format="mp4", options=options)
        self._stream = self._container.add_stream("libx264", rate=self._rate)
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"preset": PRESET, "crf": QUALITY_CRF, "bf": B_FRAMES}
        codec = self._stream.codec_context
        codec.thread_count = 1
        codec.gop_size = KEY_FRAME_EVERY
        codec.colorspace = codec.color_primaries = codec.color_trc = BT601
        codec.color_range = LIMITED


def yuv420(picture: UInt8Array) -> UInt8Array:
    """Return a picture (H, W, 3), RGB, with even sides, as planes Y, Cb, Cr below each other, (3 H / 2, W).

    A pixel of Cb and Cr is the mean of four pixels, so that thin colored lines keep their color. This takes a third of
    the time of swscale.
    """
    height, width = picture.shape[:2]
    planes = cv2.cvtColor(picture, cv2.COLOR_RGB2YUV_I420)  # its Cb and Cr come from every fourth pixel
    half = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    chroma = planes[height:].reshape(2, height // 2, width // 2)
    chroma[:] = np.moveaxis(cv2.transform(half, CHROMA), 2, 0)
    return np.asarray(planes, np.uint8)


class GifWriter(VideoWriter):
    """Writes a GIF that repeats forever, with small pictures and a palette made for them.

    Add every picture: the writer keeps every n-th of the `frames` announced pictures, at most `GIF_FRAMES`. They stay
    in memory until `close` (about 36 MB), since the palette depends on all of them.

    Parameters
    ----------
    path : Path
        The file; it appears, or is replaced, when `close` is called.
    frames : int
        Number of pictures that will be added.
    """

    def __init__(self, path: Path, frames: int) -> None:
        self._file = PendingFile(path)
        self._every = -(-frames // GIF_FRAMES)
        self._added = 0
        self._kept: list[UInt8Array] = []

    def add(self, picture: UInt8Array) -> None:
        """Append a picture (H, W, 3), RGB; all have one size."""
        if self._added % self._every == 0:
            self._kept.append(shrunk(picture, GIF_WIDTH_PX))
        self._added += 1

    def close(self) -> None:
        """Finish the file; without pictures, no file is written."""
        kept, self._kept = self._kept, []
        if not kept:
            return
        rate = Fraction(GIF_FRAMES_PER_SECOND).limit_denominator(100)
        with _encoding(self._file):
            with av.open(str(self._file.partial), "w", format="gif", options={"loop": "0"}) as container:
                stream: Any = container.add_stream("gif", rate=rate)
                stream.height, stream.width = kept[0].shape[:2]
                stream.pix_fmt = "pal8"
                for frame in _with_palette(kept, 1 / rate):
                    container.mux(stream.encode(frame))
                container.mux(stream.encode(None))
            self._file.show()

    def discard(self) -> None:
        """Leave no file."""
        self._kept = []
        self._file.drop()


@contextlib.contextmanager
def _encoding(file: PendingFile) -> Iterator[None]:
    """Turn an error of the system or of the encoder into one line, and leave no partial file."""
    try:
        with file.writing():
            yield
    except av.FFmpegError as error:
        raise OutputError(f"{file.path}: cannot be written: {error}") from error


def _with_palette(pictures: list[UInt8Array], frame_s: Fraction) -> Iterator[Any]:
    """Yield the pictures in the colors of one palette, which is computed from the pixels that change."""
    height, width = pictures[0].shape[:2]
    graph = av.filter.Graph()
    shape = av.VideoFormat("rgb24", width, height)
    source = graph.add_buffer(width=width, height=height, format=shape, time_base=frame_s)
    split, sink = graph.add("split"), graph.add("buffersink")
    make = graph.add("palettegen", f"max_colors={GIF_COLORS}:stats_mode=diff")
    use = graph.add("paletteuse", GIF_DITHER)
    source.link_to(split)
    split.link_to(make, 0, 0)
    split.link_to(use, 1, 0)
    make.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    for number, picture in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts, frame.time_base = number, frame_s
        graph.push(frame)
    graph.push(None)
    with contextlib.suppress(av.error.EOFError, av.error.BlockingIOError):
        while True:
            yield graph.pull()
