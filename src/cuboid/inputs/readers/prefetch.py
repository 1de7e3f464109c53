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
    """Iterate over `items`, which a separate thread produces up to `capacity` items ahead.

    The order is kept, and exceptions are raised where they would be without the thread. If the consumer stops early
    (closes or drops the generator), the thread ends before the close returns.
    """
    ready: queue.Queue[T | _End] = queue.Queue(maxsize=capacity)
    stop = threading.Event()

    def produce() -> None:
        try:
            for item in items:
                ready.put(item)
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
            if isinstance(item, _End):
                if item.error is not None:
                    raise item.error
                return
            yield item
    finally:
        stop.set()
        while thread.is_alive():  # the thread may wait for a free place in the queue
            while not ready.empty():
                ready.get_nowait()
            thread.join(timeout=0.005)
