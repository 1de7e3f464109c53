"""Work that runs ahead of its consumer in one thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _End:
    """Marks the end of the items, with the exception that ended the work, if any."""

    error: BaseException | None


def run_ahead(items: Iterable[T], capacity: int) -> Generator[T, None, None]:
    """Iterate over `items`, which a separate thread produces up to `capacity` items ahead of the one in use.

    The one in work counts too: the thread begins an item only when there is room for it. The order is kept, and
    exceptions are raised where they would be without the thread. If the consumer stops early (closes or drops the
    generator), the thread ends before the close returns.
    """
    ready: queue.SimpleQueue[T | _End] = queue.SimpleQueue()
    room, stop = threading.Semaphore(capacity), threading.Event()

    def produce() -> None:
        try:
            room.acquire()
            for item in items:
                ready.put(item)
                room.acquire()
                if stop.is_set():
                    return
            ready.put(_End(None))
        except BaseException as error:  # passed to the consumer, which raises it
            ready.put(_End(error))

    thread = threading.Thread(target=produce, name="cuboid-decode", daemon=True)
    thread.start()
    try:
        while True:
            item = ready.get()
            room.release()
            if isinstance(item, _End):
                if item.error is not None:
                    raise item.error
                return
            yield item
    finally:
        stop.set()
        room.release()
        thread.join()
