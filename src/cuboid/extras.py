"""Packages that only some features need: imported where they are used, and asked for in one line."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from cuboid.errors import MissingExtraError


def require(module: str, feature: str, install: str) -> Any:
    """Return a module of a package that an installation may be without.

    Parameters
    ----------
    module : str
        Its name in Python.
    feature : str
        What needs it, as the user asked for it.
    install : str
        What follows ``pip install`` to get it.

    Raises
    ------
    MissingExtraError
        It is not installed, or it does not fit this machine.
    """
    try:
        return import_module(module)
    except ImportError as error:
        reason = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be loaded ({error})"
        package = module.partition(".")[0]
        raise MissingExtraError(f"'{feature}' needs {package}, which {reason}: pip install {install}") from None
