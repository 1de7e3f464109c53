"""Names of plug-ins: registered here once; other packages add theirs through an entry point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from cuboid.ground.core.errors import InputError

T = TypeVar("T")


class Registry(Generic[T]):
    """A table from names to plug-ins.

    Parameters
    ----------
    kind : str
        Kind of the registered items, for messages ("reader", "proposal source").
    group : str
        Entry point group in which other packages declare theirs, e.g. ``cuboid.readers``.
    """

    def __init__(self, kind: str, group: str) -> None:
        self._kind = kind
        self._group = group
        self._items: dict[str, T] = {}
        self._scanned = False

    def register(self, name: str) -> Callable[[T], T]:
        """Return a decorator that registers the decorated object under `name`."""

        def add(item: T) -> T:
            self._items[name] = item
            return item

        return add

    def _scan(self) -> None:
        if self._scanned:
            return
        self._scanned = True
        for point in entry_points(group=self._group):
            self._items.setdefault(point.name, point.load())

    def names(self) -> list[str]:
        """Return all names, including those from other packages, sorted."""
        self._scan()
        return sorted(self._items)

    def items(self) -> Iterator[tuple[str, T]]:
        """Iterate over (name, item), sorted by name."""
        for name in self.names():
            yield name, self._items[name]

    def get(self, name: str) -> T:
        """Return the item of this name.

        Raises
        ------
        InputError
            If no item has this name; the message lists those that exist.
        """
        self._scan()
        if name not in self._items:
            raise InputError(f"unknown {self._kind} '{name}'; there are: {', '.join(self.names())}")
        return self._items[name]
