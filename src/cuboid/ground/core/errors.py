"""Errors in a user's input; each message is one clear line."""

from __future__ import annotations

from reprlib import Repr

# The longest line of a message, and the longest value within it, characters.
LONGEST_MESSAGE = 299
LONGEST_VALUE = 80
# A message shows only the beginning of a list or an object.
_REPR = Repr()
_REPR.maxlist = _REPR.maxtuple = 9
_REPR.maxstring = _REPR.maxlong = LONGEST_VALUE


class CuboidError(Exception):
    """An error in a call or in the input: one line says what was wrong, where, and what was expected."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class InputError(CuboidError):
    """The recording, or a file that the user named, cannot be used."""


class ConfigError(CuboidError):
    """A configuration field is unknown, of the wrong type, or out of its range."""


class OutputError(CuboidError):
    """Results cannot be written: the folder exists, is not writable, or the disk is full."""


class MissingExtraError(CuboidError):
    """A feature needs a package that is not installed; the message names the extra that installs it."""


class FrameError(CuboidError):
    """One frame of a recording cannot be used; it is skipped, and the report gives the reason."""


def printable(text: str) -> str:
    """Return text that is safe for a terminal: line breaks, escape codes and non-printable characters are escaped."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode("ascii") for char in text)


def shown(value: object) -> str:
    """Return an input value as messages show it: text quoted and escaped, at most `LONGEST_VALUE` characters."""
    if isinstance(value, int) and abs(value) >= 10**LONGEST_VALUE:  # Python refuses to write the longest ones
        return f"a whole number of {value.bit_length()} bits"
    text = f"'{printable(value[: LONGEST_VALUE + 1])}'" if isinstance(value, str) else printable(_REPR.repr(value))
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def one_line(message: str) -> str:
    """Return a message as one printable line; if it is too long, the middle is cut out."""
    line = printable(" ".join(message.split()))
    if len(line) <= LONGEST_MESSAGE:
        return line
    half = LONGEST_MESSAGE // 2 - 2
    return f"{line[:half]} ... {line[-half:]}"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun; the noun is plural unless the number is 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
