"""Readers for bags that were truncated while recording or copying: the index is rebuilt from the complete chunks.

The formats are ROS bags 2.0 (wiki.ros.org/Bags/Format/2.0) and MCAP (mcap.dev/spec); records are decoded by `rosbags`.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from contextlib import suppress
from io import BytesIO
from typing import Any

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader

MCAP_CHUNK, MCAP_MESSAGE_INDEX = 0x06, 0x07
_MCAP_RECORD = struct.Struct("<BQ")
_MCAP_CHUNK_TIMES = struct.Struct("<QQQII")
_MCAP_INDEX = struct.Struct("<HI")


class CutRos1Reader(Ros1Reader):
    """A ROS 1 bag without its final index; a chunk is used if its own index follows it."""

    def open(self) -> None:
        """Scan the records; data is read only where a new connection begins."""
        self.bio = self.path.open("rb")
        end = self.path.stat().st_size
        self.bio.readline()
        indexes: dict[int, list[Any]] = defaultdict(list)
        connections: dict[int, Any] = {}
        chunk = -1
        with suppress(Exception):  # the file ends within a record
            while self.bio.tell() < end:
                at = self.bio.tell()
                kind = Header.read(self.bio).get_uint8("op")
                size = read_uint32(self.bio)
                if self.bio.tell() + size > end:
                    break
                after = self.bio.tell() + size
                self.bio.seek(at)
                if kind == RecordType.CHUNK:
                    chunk, found = at, self.read_chunk()
                    self.chunks[at] = found
                elif kind == RecordType.IDXDATA and chunk >= 0:
                    self.read_index_data(chunk, indexes)
                    if indexes.keys() - connections.keys():
                        connections |= self._connections_in(chunk)
                self.bio.seek(after)
        self.indexes = {number: sorted(indexes[number]) for number in connections}
        self.connections = [one._replace(msgcount=len(self.indexes[number])) for number, one in connections.items()]

    def _connections_in(self, at: int) -> dict[int, Any]:
        """Return the new connections in a chunk, by number."""
        file, chunk = self.bio, self.chunks[at]
        assert file is not None, "open"
        file_at = file.tell()
        file.seek(chunk.datapos)
        inside = BytesIO(chunk.decompressor(read_bytes(file, chunk.datasize)))
        found: dict[int, Any] = {}
        try:
            self.bio = inside
            while inside.tell() < len(inside.getbuffer()):
                begin = inside.tell()
                kind = Header.read(inside).get_uint8("op")
                after = read_uint32(inside) + inside.tell()
                if kind == RecordType.CONNECTION:
                    inside.seek(begin)
                    connection = self.read_connection()
                    found[connection.id] = connection
                inside.seek(after)
        finally:
            self.bio = file
            file.seek(file_at)
        return found


class CutMcapReader(McapReader):
    """An MCAP file without its summary; a chunk is used if its message indexes follow it."""

    def _open(self) -> None:
        assert self.bio is not None, "open"
        end = self.path.stat().st_size
        self.bio.seek(8)
        _, size = _MCAP_RECORD.unpack(self.bio.read(_MCAP_RECORD.size))
        self.data_start = self.data_end = self.bio.tell() + size
        chunks: list[ChunkInfo] = []
        at = self.data_start
        while at + _MCAP_RECORD.size <= end:
            self.bio.seek(at)
            kind, size = _MCAP_RECORD.unpack(self.bio.read(_MCAP_RECORD.size))
            after = at + _MCAP_RECORD.size + size
            if kind == 0 or after > end:
                break
            if kind == MCAP_CHUNK:
                chunks.append(self._chunk(at, after - at))
            elif kind == MCAP_MESSAGE_INDEX and chunks:
                channel, length = _MCAP_INDEX.unpack(self.bio.read(_MCAP_INDEX.size))
                last = chunks[-1]
                last.message_index_offsets[channel] = at
                last.channel_count[channel] = length // 16
                chunks[-1] = last._replace(message_index_length=after - last.chunk_start_offset - last.chunk_length)
            at = self.data_end = after
        if chunks and not chunks[-1].message_index_offsets:
            self.data_end = chunks.pop().chunk_start_offset
        self.meta_scan()  # schemas and channels; decompresses each chunk once
        self.chunks = chunks

    def _chunk(self, at: int, length: int) -> ChunkInfo:
        assert self.bio is not None, "open"
        start, end, uncompressed, _, name = _MCAP_CHUNK_TIMES.unpack(self.bio.read(_MCAP_CHUNK_TIMES.size))
        compression = self.bio.read(name).decode()
        (compressed,) = struct.unpack("<Q", self.bio.read(8))
        return ChunkInfo(start, end, at, length, {}, 0, compression, compressed, uncompressed, {})
