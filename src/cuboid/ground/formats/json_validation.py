"""Validation of JSON files: from bytes to a document of its format, or a one-line error."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.formats.reading import MAX_JSON_BYTES, read_bytes

T = TypeVar("T")

# Names that msgspec gives to kinds of values.
_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "an object",
}
_BOUNDS = {">=": "of at least", "<=": "of at most", ">": "above"}


class _Head(msgspec.Struct):
    """The fields that distinguish formats."""

    format: Any = None
    version: Any = None


def read_json(path: Path, kind: type[T]) -> T:
    """Read a JSON document of a format.

    Parameters
    ----------
    path : Path
    kind : type
        The description of the format. Where it has the fields `format` and `version`, these are looked at first.

    Raises
    ------
    InputError
        The file cannot be read, is no JSON, is of another format or version, or a field is invalid; the message names
        the field, its value, and the expected value.
    """
    return checked(path, read_bytes(path, MAX_JSON_BYTES), kind)


def read_any(path: Path) -> dict[str, Any]:
    """Read a JSON object of whatever fields; raises as `read_json`."""
    return checked(path, read_bytes(path, MAX_JSON_BYTES), dict[str, Any])


def format_in(path: Path) -> str | None:
    """Return the declared format of a JSON document, if any; raises as `read_json`."""
    declared = checked(path, read_bytes(path, MAX_JSON_BYTES), _Head).format
    return declared if isinstance(declared, str) else None


def checked(path: Path, content: bytes, kind: type[T]) -> T:
    """Return the document that the content of a file is; parameters and errors as of `read_json`."""
    try:
        _refuse_other(content, kind)
        return msgspec.json.decode(content, type=kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {_explained(error, content, kind)}") from None
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: is not JSON: {_placed(error, content)}") from None
    except RecursionError:
        raise InputError(f"{path}: lists or objects lie too deep in each other") from None
    except ValueError as error:  # another format; a text that is no UTF-8
        raise InputError(f"{path}: {error}") from None


def _refuse_other(content: bytes, kind: type[Any]) -> None:
    """Raise ValueError where a document is of another format or version."""
    wanted = format_of(kind)
    if wanted is None:
        return
    head = msgspec.json.decode(content, type=_Head)
    if (head.format, head.version) != wanted:
        raise ValueError(
            f"expected format '{wanted[0]}' version {wanted[1]}, got {shown(head.format)} version {shown(head.version)}"
        )


def format_of(kind: type[Any]) -> tuple[str, int] | None:
    """Return the format's name and version that documents of a kind declare, or None."""
    if kind is _Head or not hasattr(kind, "__struct_fields__"):
        return None
    hints = get_type_hints(kind)
    if not {"format", "version"} <= set(hints) or not get_args(hints["version"]):
        return None
    return get_args(hints["format"])[0], get_args(hints["version"])[0]


def _explained(error: msgspec.ValidationError, content: bytes, kind: type[Any]) -> str:
    """Return what is wrong in a document: where, what was expected, and what is there."""
    message, _, place = str(error).partition(" - at `$")
    place = place.rstrip("`").lstrip(".")
    found = ""
    if re.match(r"Expected|Invalid|Number out", message) and not re.search(r", got [\d.]+$", message):
        found = _found(content, place)
        message = re.sub(r", got `\w+`$", "", message) if found else message
    message = in_words(message)
    if not place and ("unknown" in message or message == "expected an object"):
        message += f"{' with' if found else ', expected'} {', '.join(getattr(kind, '__struct_fields__', ('fields',)))}"
    return (f"{place}: " if place else "") + message + found


def in_words(message: str) -> str:
    """Return an error message of msgspec in plain words."""
    types = r"`(float|int|str|bool|array|object)( \| null)?`"
    message = re.sub(types, lambda found: _WORDS[found[1]] + (" or null" if found[2] else ""), message)
    message = re.sub(r"^Object missing required field `(\w+)`", r"field '\1' is missing", message)
    message = re.sub(r"^Object contains unknown field `(.*)`", r"field '\1' is unknown", message)
    message = re.sub(r"(>=|<=|>) (\S+)", lambda m: f"{_BOUNDS[m[1]]} {float(m[2]):g}", message)
    return message.replace("`", "'")[:1].lower() + message.replace("`", "'")[1:]


def _found(content: bytes, place: str) -> str:
    """Return ", got ..." with the value at a place of a document; empty if the place is not found."""
    try:
        value = msgspec.json.decode(content)
        for name, number in re.findall(r"([^.\[\]]+)|\[(\d+)\]", place):
            value = value[int(number)] if number else value[name]
    except (msgspec.DecodeError, LookupError, TypeError, ValueError, RecursionError):
        return ""
    return f", got {'null' if value is None else shown(value)}"


def _placed(error: msgspec.DecodeError, content: bytes) -> str:
    """Return what is wrong with a text that is no JSON, with its line."""
    message = str(error).removeprefix("JSON is malformed: ").removeprefix("Input data was ")
    at = re.search(r" \(byte (\d+)\)$", message)
    if at is None:
        return message
    line = content.count(b"\n", 0, int(at[1])) + 1
    return f"line {line}: {message[: at.start()]}"
