"""What can go wrong through a user's input, each as one clear line."""

from __future__ import annotations


class CuboidError(Exception):
    """A mistake in the call or in the input: the message is one line that says what, where, and what was expected."""


class InputError(CuboidError):
    """The recording, or a file that the user named, cannot be used."""


class ConfigError(CuboidError):
    """A configuration field is unknown, of the wrong type, or out of its range."""


class OutputError(CuboidError):
    """Results cannot be written: the folder exists, is not writable, or the disk is full."""


class MissingExtraError(CuboidError):
    """A feature needs a package that is not installed; the message names the extra that brings it."""


class FrameError(CuboidError):
    """One frame of a recording cannot be used; it is skipped, and the report gives the reason."""
