"""Types of kernels' arguments as JSON, so that kernels can be compiled before they are called.

A number is `"float64"`; an array `"float32 2C"`: type, dimensions, layout (C, F or A for any); a tuple is a list that
begins with `""`, a named tuple one that begins with its class, and the types of the items follow.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from numba import types


def encode(value: Any) -> Any:
    """Return a numba type as JSON.

    Raises
    ------
    TypeError
        If it is none of the types above.
    """
    if isinstance(value, types.Array) and value.mutable and value.aligned:
        return f"{value.dtype} {value.ndim}{value.layout}"
    is_tuple = isinstance(value, types.BaseTuple)
    if is_tuple:
        cls = getattr(value, "instance_class", None)
        return ["" if cls is None else f"{cls.__module__}.{cls.__qualname__}", *map(encode, value)]
    if isinstance(value, types.Number | types.Boolean):
        return str(value)
    raise TypeError(f"no JSON for the type {value}")


def decode(text: Any) -> Any:
    """Return a numba type from its JSON."""
    if isinstance(text, list):
        items = tuple(map(decode, text[1:]))
        if not text[0]:
            return types.BaseTuple.from_types(items)
        module, _, name = text[0].rpartition(".")
        return types.BaseTuple.from_types(items, getattr(import_module(module), name))
    name, _, shape = text.partition(" ")
    dtype = types.boolean if name == "bool" else getattr(types, name)
    return types.Array(dtype, int(shape[:-1]), shape[-1]) if shape else dtype
