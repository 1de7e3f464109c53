"""Log times of the messages in an MCAP file, from its indexes only, without reading messages (mcap.dev/spec)."""

from __future__ import annotations

import os
import struct
import sys
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

# A MessageIndex record: operation code and length, channel, bytes of the array; then pairs of log time and offset.
_HEADER, _ENTRY_BYTES = struct.Struct("<BQHI"), 16
# Maximum size of the indexes after a chunk; only damaged files exceed it.
MAX_INDEX_BYTES = 1 << 26

Times = npt.NDArray[np.int64]


def mcap_times(owner: Any) -> dict[int, Times]:
    """Return the log times of each channel, nanoseconds, increasing, from the message indexes after the chunks.

    The indexes of a chunk are adjacent and are read at once. For local files, the system is informed beforehand which
    parts will be read, so that it can prefetch them.

    Parameters
    ----------
    owner : rosbags' storage of an MCAP file
        Storage with its `chunks` and its open file.

    Raises
    ------
    ValueError, struct.error
        The file is damaged.
    """
    found: dict[int, list[Times]] = {}
    parts = [
        (min(chunk.message_index_offsets.values()), chunk.message_index_length, chunk.message_index_offsets)
        for chunk in owner.chunks
        if chunk.message_index_offsets
    ]
    _announce(owner.bio, [(start, length) for start, length, _ in parts])
    for start, length, offsets in parts:
        if length > MAX_INDEX_BYTES:
            raise ValueError(f"{length} bytes of message indexes at byte {start}")
        owner.bio.seek(start)
        data = owner.bio.read(length)
        for channel, offset in offsets.items():
            found.setdefault(channel, []).append(_times(data, offset - start, channel, offset))
    return {channel: np.sort(np.concatenate(times)) for channel, times in found.items()}


def _times(data: bytes, at: int, channel: int, offset: int) -> Times:
    """Return the times in the index of one channel within the indexes of a chunk."""
    _, _, of_channel, size = _HEADER.unpack_from(data, at)
    begin = at + _HEADER.size
    if of_channel != channel or begin + size > len(data):
        raise ValueError(f"no message index of channel {channel} at byte {offset}")
    pairs = np.frombuffer(data, "<u8", size // _ENTRY_BYTES * 2, begin).reshape(-1, 2)
    return pairs[:, 0].astype(np.int64)


def _announce(file: Any, parts: list[tuple[int, int]]) -> None:
    """Announce to the system which parts of a local file will be read."""
    if sys.platform == "linux":
        with suppress(OSError, ValueError, OverflowError, AttributeError):
            for start, length in parts:
                os.posix_fadvise(file.fileno(), start, length, os.POSIX_FADV_WILLNEED)
