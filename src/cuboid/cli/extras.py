"""Packages that a command needs beyond the core: one line where they are missing."""

from __future__ import annotations

from importlib.util import find_spec

from cuboid.errors import MissingExtraError

CLUSTER = ("distributed", "pyarrow", "duckdb", "fsspec", "starlette", "uvicorn")


def need_cluster(what: str) -> None:
    """Raise where a package of the extra `cluster` is missing.

    Parameters
    ----------
    what : str
        What needs it, as the user called it.

    Raises
    ------
    MissingExtraError
    """
    missing = [name for name in CLUSTER if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"{what} needs {', '.join(missing)}: pip install 'cuboid[cluster]'")
