"""Positions of the blocks and attachments in a Matroska file, without reading their data.

The elements are defined in RFC 9559, the coding of numbers and lengths in RFC 8794 (EBML). Of a truncated file, the
complete blocks are listed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

EBML, SEGMENT, CLUSTER, BLOCK_GROUP = 0x1A45DFA3, 0x18538067, 0x1F43B675, 0xA0
INFO, TIMESTAMP_SCALE = 0x1549A966, 0x2AD7B1
TRACKS, TRACK, TRACK_NUMBER, TRACK_NAME, CODEC, CODEC_PRIVATE = 0x1654AE6B, 0xAE, 0xD7, 0x536E, 0x86, 0x63A2
VIDEO, WIDTH, HEIGHT = 0xE0, 0xB0, 0xBA
CLUSTER_TIME, SIMPLE_BLOCK, BLOCK = 0xE7, 0xA3, 0xA1
ATTACHMENTS, ATTACHED, FILE_NAME, FILE_DATA = 0x1941A469, 0x61A7, 0x466E, 0x465C
# Elements that contain elements.
FOLDERS = {SEGMENT, CLUSTER, BLOCK_GROUP, INFO, TRACKS, TRACK, VIDEO, ATTACHMENTS, ATTACHED}
MAGIC = b"\x1a\x45\xdf\xa3"
# Maximum length of numbers and names; pictures are not read here.
MAX_VALUE_BYTES = 1 << 16
DEFAULT_SCALE_NS = 1_000_000


@dataclass(slots=True)
class Track:
    """A track: its name, codec, the codec's private data, and the size of its pictures."""

    number: int = 0
    name: str = ""
    codec: str = ""
    private: bytes = b""
    width: int = 0
    height: int = 0


@dataclass(frozen=True, slots=True)
class Block:
    """The position of a block's data: time in nanoseconds, offset and length in bytes."""

    time_ns: int
    offset: int
    length: int


@dataclass(slots=True)
class Matroska:
    """The contents of a file.

    Attributes
    ----------
    tracks : dict of int to Track
    blocks : dict of int to list of Block
        Of each track, in the order of the file.
    attachments : dict of str to (int, int)
        Offset and length of the data by name.
    """

    tracks: dict[int, Track] = field(default_factory=dict)
    blocks: dict[int, list[Block]] = field(default_factory=dict)
    attachments: dict[str, tuple[int, int]] = field(default_factory=dict)


def list_matroska(path: Path) -> Matroska:
    """List the contents of a Matroska file, by the lengths of its elements.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no Matroska file.
    """
    with path.open("rb") as file:
        if file.read(4) != MAGIC:
            raise ValueError("it is no Matroska file")
        found, state = Matroska(), _State()
        for kind, offset, length in _elements(file, 0, path.stat().st_size):
            state.take(found, file, kind, offset, length)
    return found


@dataclass(slots=True)
class _State:
    """The last values that were read; they apply to the following blocks."""

    scale_ns: int = DEFAULT_SCALE_NS
    cluster: int = 0
    track: Track = field(default_factory=Track)
    attachment: str = ""

    def take(self, found: Matroska, file: BinaryIO, kind: int, offset: int, length: int) -> None:
        """Process one element."""
        if kind in (SIMPLE_BLOCK, BLOCK):
            self._block(found, file, offset, length)
        elif kind == FILE_DATA:
            found.attachments[self.attachment] = (offset, length)
        elif kind == TRACK:
            self.track = Track()
        elif kind in _FIELDS and length <= MAX_VALUE_BYTES:
            file.seek(offset)
            self._field(found, kind, file.read(length))

    def _field(self, found: Matroska, kind: int, data: bytes) -> None:
        number, text = int.from_bytes(data[:8], "big"), data.rstrip(b"\0").decode("utf-8", "replace")
        if kind == TIMESTAMP_SCALE:
            self.scale_ns = number or DEFAULT_SCALE_NS
        elif kind == CLUSTER_TIME:
            self.cluster = number
        elif kind == FILE_NAME:
            self.attachment = text
        elif kind == TRACK_NUMBER:
            self.track.number = number
            found.tracks[number] = self.track
        elif kind == TRACK_NAME:
            self.track.name = text
        elif kind == CODEC:
            self.track.codec = text
        elif kind == CODEC_PRIVATE:
            self.track.private = data
        elif kind == WIDTH:
            self.track.width = number
        elif kind == HEIGHT:
            self.track.height = number

    def _block(self, found: Matroska, file: BinaryIO, offset: int, length: int) -> None:
        """Process a block: track number, time relative to the cluster (16 bits), flags, then one frame."""
        file.seek(offset)
        head = file.read(min(length, 11))
        size = _length_of(head[0]) if head else 0
        if not size or len(head) < size + 3 or head[size + 2] & 0x06:  # several frames in one block: not in videos
            return
        track = int.from_bytes(head[:size], "big") & ((1 << (7 * size)) - 1)
        after = int.from_bytes(head[size : size + 2], "big", signed=True)
        time_ns = (self.cluster + after) * self.scale_ns
        found.blocks.setdefault(track, []).append(Block(time_ns, offset + size + 3, length - size - 3))


_OF_TRACK = (TRACK_NUMBER, TRACK_NAME, CODEC, CODEC_PRIVATE, WIDTH, HEIGHT)
_FIELDS = {TIMESTAMP_SCALE, CLUSTER_TIME, FILE_NAME, *_OF_TRACK}


def _elements(file: BinaryIO, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, content offset and content length of each complete element, containers before their contents."""
    at = start
    while at < end:
        file.seek(at)
        head = file.read(12)
        kind_size = _length_of(head[0]) if head else 0
        size_at = head[kind_size] if kind_size and len(head) > kind_size else 0
        size = _length_of(size_at)
        if not 0 < kind_size <= 4 or not size or len(head) < kind_size + size:
            return  # no element begins here: the file is damaged
        kind = int.from_bytes(head[:kind_size], "big")
        length = int.from_bytes(head[kind_size : kind_size + size], "big") & ((1 << (7 * size)) - 1)
        offset = at + kind_size + size
        if length == (1 << (7 * size)) - 1:  # unknown length: to the end of the container
            length = end - offset
        if kind in FOLDERS:
            yield kind, offset, min(length, end - offset)
            at = offset  # descend; the next element follows the container's last one
        else:
            if offset + length > end:
                return
            yield kind, offset, length
            at = offset + length


def _length_of(first: int) -> int:
    """Return the length in bytes of a number from its first byte; 0 if it is invalid."""
    return 9 - first.bit_length() if first else 0
