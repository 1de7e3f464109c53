"""Packages that only some features need: imported where they are used; if one is missing, one line says so."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from cuboid.ground.core.errors import MissingExtraError

NOT_INSTALLED = "is not installed"
# Modules of the extra `cluster`.
CLUSTER = ("distributed", "pyarrow", "duckdb", "fsspec", "starlette", "uvicorn")
# Modules of the extra `serve`.
SERVE = ("starlette", "uvicorn", "websockets")


# Compiles the kernels at the installation of a checkout, beside the packages that are installed already.
COMPILED_INSTALL = "pip install --no-deps --no-build-isolation ."


def how_to_install(extra: str = "", *, pip: str = "") -> str:
    """Return how to install an extra of Cuboid, or a package that is in no extra.

    Parameters
    ----------
    extra : str, optional
        Name of the extra in ``pyproject.toml``.
    pip : str, optional
        Arguments of ``pip install``, instead of an extra.
    """
    if pip:
        return f"pip install {pip}"
    return f"install the extra '{extra}': pip install '.[{extra}]' in a checkout of Cuboid"


def missing(feature: str, package: str, extra: str = "", *, pip: str = "", reason: str = NOT_INSTALLED) -> str:
    """Return the message of a package that is not installed.

    Parameters
    ----------
    feature : str
        The feature that needs the package.
    package : str
        Name of the package.
    extra, pip : str, optional
        As for `how_to_install`.
    reason : str, optional
        The problem with the package.
    """
    return f"{feature} needs {package}, which {reason}: {how_to_install(extra, pip=pip)}"


def require(module: str, feature: str, extra: str = "", *, pip: str = "") -> Any:
    """Return a module of an optional package.

    Parameters
    ----------
    module : str
        Its import name.
    feature : str
        The feature that needs it, in the user's words.
    extra, pip : str, optional
        As for `how_to_install`.

    Raises
    ------
    MissingExtraError
        If it is not installed, or cannot be loaded on this machine.
    """
    try:
        return import_module(module)
    except ImportError as error:
        reason = NOT_INSTALLED if isinstance(error, ModuleNotFoundError) else f"cannot be loaded ({error})"
        package = module.partition(".")[0]
        raise MissingExtraError(missing(f"'{feature}'", package, extra, pip=pip, reason=reason)) from None


def need_cluster(feature: str) -> None:
    """Check that all packages of the extra `cluster` are installed, without importing them.

    Parameters
    ----------
    feature : str
        The feature that needs them, in the user's words.

    Raises
    ------
    MissingExtraError
    """
    _need(CLUSTER, feature, "cluster")


def need_serve(feature: str) -> None:
    """Check the packages of the extra `serve` as `need_cluster` does."""
    _need(SERVE, feature, "serve")


def _need(modules: Sequence[str], feature: str, extra: str) -> None:
    absent = [name for name in modules if find_spec(name) is None]
    if absent:
        reason = NOT_INSTALLED if len(absent) == 1 else "are not installed"
        raise MissingExtraError(missing(f"'{feature}'", ", ".join(absent), extra, reason=reason))
