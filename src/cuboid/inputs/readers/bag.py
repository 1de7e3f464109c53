"""Bags of ROS 1 and ROS 2, opened with `rosbags` for reading single messages."""

from __future__ import annotations

import threading
import weakref
from bisect import bisect_left
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.extras import missing
from cuboid.ground.formats.stored import local_file
from cuboid.inputs.readers.bag_mcap import Times, mcap_times
from cuboid.inputs.readers.images import head_of

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC = b"#ROSBAG V2", b"\x89MCAP0\r\n", b"SQLite format 3\x00"
MAGIC = {".bag": ROS1_MAGIC, ".mcap": MCAP_MAGIC, ".db3": SQLITE_MAGIC}
# Number of cached decoded messages: color and depth of a frame are requested for its pose and for its images.
KEPT_MESSAGES = 6


def is_bag_file(path: Path) -> bool:
    """Tell whether a file is a bag, by its name's ending and its first bytes."""
    magic = MAGIC.get(path.suffix)
    return magic is not None and head_of(path, len(magic)) == magic


class Bag:
    """One recording of ROS messages, in one file or several consecutive ones.

    Parameters
    ----------
    paths : sequence of Path
        Files of the bag.

    Attributes
    ----------
    name : str
        Name of the first file, for messages.
    types : dict of str to str
        Message type of each topic, such as "sensor_msgs/msg/Image".

    Raises
    ------
    InputError
        A file cannot be read as a bag, or `rosbags` is not installed.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._lock = threading.Lock()  # a file has one position, and frames are decoded in another thread
        self.name = paths[0].name
        self._parts = [(path, _open(path)) for path in paths]
        self._close = weakref.finalize(self, _close_all, [reader for _, reader in self._parts])
        self._connections: dict[str, list[tuple[int, Connection]]] = {}
        self.types: dict[str, str] = {}
        for part, (_, reader) in enumerate(self._parts):
            for connection in reader.connections:
                self.types.setdefault(connection.topic, connection.msgtype)
                self._connections.setdefault(connection.topic, []).append((part, connection))
        self._kept: OrderedDict[tuple[str, int], Any] = OrderedDict()
        self._mcap_times: dict[int, dict[int, Times]] = {}
        self._times: dict[str, tuple[Times, npt.NDArray[np.int64]]] = {}

    def times(self, topic: str) -> Times:
        """Return the log time of each message of a topic, nanoseconds, increasing (N,), without reading messages.

        Raises
        ------
        InputError
            The file's index is damaged.
        """
        return self._listed(topic)[0]

    def read(self, topic: str, time_ns: int) -> Any:
        """Return the message of a topic that was logged at this time.

        Raises
        ------
        FrameError
            The message cannot be read.
        """
        with self._lock:
            if (topic, time_ns) in self._kept:
                return self._kept[topic, time_ns]
            times, which = self._listed(topic)
            part, connection = self._connections[topic][which[int(np.searchsorted(times, time_ns))]]
            found = self._guarded(part, partial(self._message, part, connection, time_ns), FrameError)
            self._kept[topic, time_ns] = found
            if len(self._kept) > KEPT_MESSAGES:
                self._kept.popitem(last=False)
            return found

    def first(self, topic: str) -> Any:
        """Return the first message of a topic; None if there is no readable message."""
        times = self.times(topic)
        with suppress(FrameError):
            return self.read(topic, int(times[0])) if len(times) else None
        return None

    def between(self, topic: str, start_ns: int, stop_ns: int) -> list[Any]:
        """Return the readable messages of a topic that were logged in a time span."""
        found: list[Any] = []
        for part, connection in self._connections.get(topic, ()):
            work = partial(self._span, part, connection, start_ns, stop_ns, found)
            with self._lock, suppress(FrameError):
                self._guarded(part, work, FrameError)
        return found

    def _listed(self, topic: str) -> tuple[Times, npt.NDArray[np.int64]]:
        """Return the times of a topic's messages, and the connection number of each."""
        if topic not in self._times:
            times, which = [], []
            for k, (part, connection) in enumerate(self._connections[topic]):
                found = self._guarded(part, partial(self._index, part, connection), InputError)
                times.append(found)
                which.append(np.full(len(found), k, np.int64))
            all_times, all_which = np.concatenate(times), np.concatenate(which)
            order = np.argsort(all_times, kind="stable")
            self._times[topic] = (all_times[order], all_which[order])
        return self._times[topic]

    def _index(self, part: int, connection: Connection) -> Times:
        """Return the times of one connection's messages from the index of its file."""
        owner: Any = connection.owner
        if hasattr(owner, "indexes"):  # ROS 1
            return np.array([entry.time for entry in owner.indexes[connection.id]], np.int64)
        if hasattr(owner, "dbconn"):  # SQLite
            rows = owner.dbconn.execute("SELECT timestamp FROM messages WHERE topic_id = ?", (connection.id,))
            return np.sort(np.array([row[0] for row in rows], np.int64))
        if owner.chunks:  # MCAP
            if part not in self._mcap_times:
                self._mcap_times[part] = mcap_times(owner)
            return self._mcap_times[part].get(connection.id, np.zeros(0, np.int64))
        reader = self._parts[part][1]  # MCAP without an index: iterate over all messages
        return np.array([time_ns for _, time_ns, _ in reader.messages([connection])], np.int64)

    def _message(self, part: int, connection: Connection, time_ns: int) -> Any:
        reader, owner = self._parts[part][1], connection.owner
        indexes: Any = getattr(owner, "indexes", None)
        if indexes is not None:  # rosbags would walk the whole index up to the message
            whole = indexes[connection.id]
            first = bisect_left(whole, time_ns, key=lambda entry: entry.time)
            indexes[connection.id] = whole[first : first + 1]
        try:
            messages = reader.messages([connection], time_ns, time_ns + 1)
            for _, _, data in messages:
                return reader.deserialize(data, connection.msgtype)
        finally:
            if indexes is not None:
                indexes[connection.id] = whole
        raise ValueError("the message is not where the index says")

    def _span(self, part: int, connection: Connection, start_ns: int, stop_ns: int, found: list[Any]) -> None:
        reader = self._parts[part][1]
        for _, _, data in reader.messages([connection], start_ns, stop_ns):
            found.append(reader.deserialize(data, connection.msgtype))

    def _guarded(self, part: int, work: Callable[[], Any], error: type[FrameError | InputError]) -> Any:
        """Run code that may fail on a damaged file: the library then raises all kinds of errors."""
        try:
            return work()
        except Exception as fault:
            raise error(f"{self._parts[part][0].name}: damaged: {_line(fault)}") from None


def _open(path: Path) -> AnyReader:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(missing(f"{path}: a bag", "rosbags", "ros")) from None
    if path.suffix == ".db3":  # SQLite needs a real file
        try:
            path = local_file(path)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    store = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)
    try:
        reader = AnyReader([path], default_typestore=store)
        reader.open()
    except Exception as fault:  # the library raises all kinds of errors on damaged files
        mended = _mended(path, store)
        if mended is None:
            raise InputError(f"{path}: cannot be read as a bag: {_line(fault)}") from None
        return mended
    return reader


def _mended(path: Path, store: Any) -> AnyReader | None:
    """Open the complete part of a bag whose end is missing; None if there is none."""
    from rosbags.highlevel import AnyReader

    from cuboid.inputs.readers.bag_mending import CutMcapReader, CutRos1Reader

    with suppress(Exception):  # as above
        reader = AnyReader([path], default_typestore=store)
        inner: Any = reader.readers[0]
        if path.suffix == ".bag":
            reader.readers = [CutRos1Reader(path)]
        elif path.suffix == ".mcap":
            inner.storage = CutMcapReader(path)
        else:
            return None
        reader.open()
        if reader.connections:
            return reader
        reader.close()
    return None


def _close_all(readers: list[AnyReader]) -> None:
    for reader in readers:
        with suppress(Exception):
            reader.close()


def _line(fault: Exception) -> str:
    return " ".join(str(fault).split())[:160] or type(fault).__name__
