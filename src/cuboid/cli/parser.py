"""The parser of the command line: its error messages are one line and suggest the word that was probably meant."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from math import inf
from typing import Any, NoReturn, TypeVar

from cuboid.ground.core.errors import one_line

MISTAKE = 2
# An error message lists the choices if there are at most this many.
LISTED = 8

N = TypeVar("N", int, float)


class Parser(argparse.ArgumentParser):
    """A parser whose error messages are one line.

    Attributes
    ----------
    example : str
        A valid call, shown if a required argument is missing.
    """

    example = "cuboid demo"
    _nothing_given = False

    def error(self, message: str) -> NoReturn:
        """Print the error message, and exit."""
        message = message.replace("-o/--output", "--output")
        if self._nothing_given and "required: " in message:
            listed, named = message.split("required: ")
            others = [str(one.metavar) for one in self._actions if not one.option_strings and one.nargs in ("?", "*")]
            message = f"{listed}required: {', '.join([*others, *named.split(', ')])}"
        shown = f"; for example: {self.example}" if "required: " in message else ""
        line = one_line(f"cuboid: error: {message}{shown} (see '{self.prog} --help')")
        self.exit(MISTAKE, f"{line}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            hint = did_you_mean(str(value), choices)
            listed = f" (choose from {', '.join(choices)})" if len(choices) <= LISTED or not hint else ""
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{hint}{listed}")

    def format_help(self) -> str:
        """Return the help; for options that take a name, it lists the names."""
        for action in self._actions:
            names = getattr(action, "names", None)
            if names is not None and action.help:
                action.help = f"{action.help}: {_listed(names())}"
                del action.names  # type: ignore[attr-defined]
        return super().format_help()

    def refuse_unknown_options(self, words: Sequence[str]) -> None:
        """Exit with an error if an option does not exist; this comes before errors about missing arguments."""
        self._nothing_given = not words
        options = set(self._options(words))
        for word in words:
            name = word.split("=")[0]
            if name in ("--", "-h", "--help"):
                return
            if name.startswith("--") and " " not in name and name not in options:
                self.error(f"unrecognized arguments: {name}{did_you_mean(name, options)}")

    def _options(self, words: Sequence[str]) -> Iterable[str]:
        """Iterate over all options, those of the chosen verb included."""
        yield from self._option_string_actions
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                for word in words:
                    if word in action.choices:
                        yield from action.choices[word]._option_string_actions
                        return


def did_you_mean(word: str, words: Iterable[str]) -> str:
    """Return a hint at the known word most similar to the given one; an empty text if none is similar."""
    from difflib import get_close_matches

    words = sorted(words)
    near = get_close_matches(word, words, n=1) or [one for one in words if one.startswith(f"{word} ")][:1]
    return f"; did you mean '{near[0]}'?" if near else ""


def _listed(names: Iterable[str]) -> str:
    """Return the names, with their meanings if given, as text for a help."""
    if isinstance(names, Mapping):
        return "; ".join(f"{name}, for {meaning}" for name, meaning in names.items()).replace("%", "%%")
    return ", ".join(names)


def takes_names(action: argparse.Action, names: Callable[[], Iterable[str]], *, ending: str = "") -> None:
    """Mark an option so that the shell completes its names and its help lists them.

    Parameters
    ----------
    action : argparse.Action
    names : callable
        Returns the names, or a mapping from names to meanings. It is called only when the names are needed, since it
        may import large modules.
    ending : str
        Text that follows a name, such as "=" for NAME=VALUE.
    """
    action.names = names  # type: ignore[attr-defined]
    action.completer = lambda **_: [f"{name}{ending}" for name in names()]  # type: ignore[attr-defined]


def number(kind: Callable[[str], N], holds: Callable[[N], bool], expected: str) -> Callable[[str], N]:
    """Return a parser of the numbers for which a condition holds; the message about others says what is expected."""

    def read(text: str) -> N:
        with suppress(ValueError):
            value = kind(text)
            if holds(value):
                return value
        raise argparse.ArgumentTypeError(f"expected {expected}, got '{text}'")

    return read


whole = number(int, lambda value: value >= 0, "a whole number of at least 0")
positive = number(int, lambda value: value >= 1, "a whole number of at least 1")
port = number(int, lambda value: 0 <= value <= 65535, "a port, 0 to 65535")
probability = number(float, lambda value: 0 <= value <= 1, "a probability from 0 to 1")
depth_scale = number(float, lambda value: 0 < value < inf, "depth units per metre, above 0")
seconds = number(float, lambda value: 0 < value < inf, "seconds, above 0")
megabytes = number(float, lambda value: 0 < value < inf, "megabytes, above 0")
_milliseconds = number(float, lambda value: abs(value) <= 10_000, "auto, off, or milliseconds up to 10000")


def pose_offset(text: str) -> str | float:
    """Parse auto, off, or a number of milliseconds."""
    return text if text in ("auto", "off") else _milliseconds(text)
