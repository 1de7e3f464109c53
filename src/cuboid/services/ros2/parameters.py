"""The parameters of the node: settings of its messages that users can change during a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from cuboid.ground.core.errors import InputError
from cuboid.results.views.ros_stream import StreamSettings

# Maximum values; the minimum is 0.
MAX_VALUES = {"min_probability": 1.0, "map_every_s": float("inf")}


class Parameters:
    """The parameters by name.

    Parameters
    ----------
    apply : callable
        Called with the settings after each change.
    """

    def __init__(self, apply: Callable[[StreamSettings], None]) -> None:
        self._apply = apply
        self._settings = StreamSettings()

    @property
    def values(self) -> dict[str, Any]:
        """The values, by name."""
        return dataclasses.asdict(self._settings)

    def set(self, name: str, value: Any) -> None:
        """Change a parameter.

        Raises
        ------
        InputError
            No parameter has that name, or the value has another type or is out of range.
        """
        values = self.values
        if name not in values:
            raise InputError(f"there is no parameter '{name}'; expected one of {', '.join(values)}")
        try:
            checked: Any = msgspec.convert(value, type(values[name]))
        except msgspec.ValidationError as error:
            raise InputError(f"parameter {name}: {error}") from None
        if name in MAX_VALUES and not 0 <= checked <= MAX_VALUES[name]:
            raise InputError(f"parameter {name}: expected a number from 0 to {MAX_VALUES[name]:g}, got {checked:g}")
        self._settings = dataclasses.replace(self._settings, **{name: checked})
        self._apply(self._settings)

    def set_texts(self, texts: Sequence[str]) -> None:
        """Change parameters from texts NAME=VALUE with values in JSON; raise InputError as `set` does."""
        for text in texts:
            name, equals, value = text.partition("=")
            if not equals:
                raise InputError(f"--param: expected NAME=VALUE, got '{text}'")
            try:
                self.set(name, msgspec.json.decode(value))
            except msgspec.DecodeError:
                raise InputError(f"parameter {name}: expected true, false or a number, got '{value}'") from None
