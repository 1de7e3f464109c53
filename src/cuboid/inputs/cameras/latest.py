"""A queue between a camera, which does not wait, and a consumer that is sometimes slower."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Generic, TypeVar

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.formats.folder import ResultFolder, writing
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.recordings.converting import WRITERS, units_kept

# Formats in which a live camera can be recorded.
FORMS = ("plain", "mcap")


@contextmanager
def keeping(
    folder: Path, form: str, intrinsics: Intrinsics, depth_units_per_metre: float, depth_camera: DepthCamera | None
) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that writes a frame; the folder appears at the end, also after an error, if it has frames.

    Raises
    ------
    OutputError
        The folder exists, or cannot be written.
    """
    written, finished = 0, False
    units = units_kept(depth_units_per_metre, depth_camera)
    with ResultFolder(folder) as place, writing(folder):
        writer = WRITERS[form](place.file(""), intrinsics, units, None)

        def write(frame: Frame) -> None:
            nonlocal written
            with writing(folder):
                writer.add(frame)
            written += 1

        try:
            with writer:
                try:
                    yield write
                finally:
                    if written:
                        writer.finish()
                        finished = True
        finally:
            if finished:
                place.commit()


T = TypeVar("T")
# Interval at which a waiting consumer checks for a stop, seconds.
POLL_S = 0.1


class LatestQueue(Generic[T]):
    """Holds the last few items; a new item pushes out the oldest one, which is counted.

    Parameters
    ----------
    capacity : int
    paced : bool
        Whether `put` waits for a free place instead.
    changed : Condition, optional
        Notified of each change; several queues with one consumer share it.

    Attributes
    ----------
    dropped : int
        Items that were pushed out.
    paced : bool
    """

    def __init__(self, capacity: int, *, paced: bool = False, changed: threading.Condition | None = None) -> None:
        self.dropped, self.paced = 0, paced
        self._capacity = capacity
        self._items: deque[T] = deque()
        self._changed = changed or threading.Condition()
        self._stopped = threading.Event()
        self._ended = False

    def put(self, item: T) -> None:
        """Add an item; without effect once the queue was stopped."""
        with self._changed:
            while self.paced and len(self._items) >= self._capacity and not self._stopped.is_set():
                self._changed.wait(POLL_S)
            if len(self._items) >= self._capacity:
                self._items.popleft()
                self.dropped += 1
            self._items.append(item)
            self._changed.notify_all()

    def end(self) -> None:
        """Mark the end of the items; remaining items are still returned."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def stop(self) -> None:
        """End at once and discard remaining items; takes no lock, so that a signal handler may call it."""
        self._stopped.set()

    def head(self) -> T | None:
        """Return the oldest item, which remains in the queue; None if there is none now, or the queue was stopped."""
        with self._changed:
            return self._items[0] if self._items and not self._stopped.is_set() else None

    @property
    def exhausted(self) -> bool:
        """Whether there are no more items, now and later."""
        with self._changed:
            return self._stopped.is_set() or (self._ended and not self._items)

    def get(self, idle: Callable[[], None] = lambda: None) -> T | None:
        """Wait for the oldest item and return it; None if there are no more items.

        Parameters
        ----------
        idle : callable
            Called repeatedly during the wait.
        """
        while not self._stopped.is_set():
            with self._changed:
                if not (self._items or self._ended):
                    self._changed.wait(POLL_S)
                if self._items:
                    item = self._items.popleft()
                    self._changed.notify_all()
                    return item
                if self._ended:
                    return None
            idle()
        return None
