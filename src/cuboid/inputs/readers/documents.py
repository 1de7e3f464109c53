"""JSON documents that lie beside recordings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.reading import read_bytes

# Maximum size of a document, bytes: enough for a pose of every frame of an hour.
MAX_DOCUMENT_BYTES = 256 << 20


def read_object(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises
    ------
    InputError
        The file cannot be read, is too large, is not JSON, or contains something else.
    """
    return parse_object(read_bytes(path, MAX_DOCUMENT_BYTES), str(path))


def parse_object(data: bytes, where: str) -> dict[str, Any]:
    """Return the object in JSON text; raise InputError if there is none."""
    try:
        document: Any = json.loads(data, parse_int=_whole)
    except json.JSONDecodeError as error:
        raise InputError(f"{where} line {error.lineno}: not valid JSON ({error.msg})") from None
    except (ValueError, RecursionError):  # no UTF-8, a number of thousands of digits, too deep
        raise InputError(f"{where} is not a JSON text") from None
    if not isinstance(document, dict):
        raise InputError(f"{where}: expected a JSON object")
    return document


def _whole(digits: str) -> int | float:
    """Return an integer; beyond 64 bits a float or infinity, which later validation refuses."""
    return int(digits) if len(digits) < 19 else float(digits)
