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
    """Comes behind the last item; with the exception that ended the work, if one did."""

    error: BaseException | None


def run_ahead(items: Iterable[T], capacity: int) -> Generator[T, None, None]:
    """Iterate over `items`, which a thread of its own produces up to `capacity` items ahead.

    Order is kept and exceptions arrive where they would without the thread. When the consumer stops early
    (closes the generator, or lets go of it), the thread ends before the close returns.
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
        except BaseException as error:  # carried over to the consumer, who raises it
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
        while thread.is_alive():  # it may wait for a free place in the queue
            while not ready.empty():
                ready.get_nowait()
            thread.join(timeout=0.005)
