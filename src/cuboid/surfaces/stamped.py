"""Objects with a modification counter."""

from __future__ import annotations


class Stamped:
    """Counts what is assigned to its attributes: while the count stands still, the object is as it was.

    Whatever changes in place what an attribute holds also assigns to one.
    """

    __slots__ = ("_stamp",)

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, "_stamp", self.stamp + 1)
        object.__setattr__(self, name, value)

    @property
    def stamp(self) -> int:
        """How often something was assigned."""
        return int(getattr(self, "_stamp", 0))
