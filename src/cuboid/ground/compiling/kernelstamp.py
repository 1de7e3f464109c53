"""A stamp of all inputs of a kernel's compilation: its code, the functions it calls, the constants it contains.

Two kernels with the same stamp have the same machine code on the same processor. Comments, docstrings, line numbers and
other functions of the file do not affect the stamp.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

# Versions of the compilers and of NumPy: numba has its own loops for NumPy's functions.
COMPILERS = f"{sys.implementation.cache_tag} numba {numba.__version__} {llvmlite.__version__} numpy {np.__version__}"


def stamp_of(function: FunctionType, options: Mapping[str, Any]) -> str:
    """Return the stamp of a kernel, 64 hexadecimal digits.

    Parameters
    ----------
    function : FunctionType
        The Python function before compilation; everything that it uses must be defined already.
    options : mapping of str to object
        Compile options.

    Raises
    ------
    TypeError
        If the kernel uses a value for which no stamp can be made.
    """
    found: dict[str, str] = {}
    _collect(function, options, found)
    functions = [f"{name} {found[name]}" for name in sorted(found)]
    return hashlib.sha256("\n".join([_name(function), COMPILERS, *functions]).encode()).hexdigest()


def _collect(function: FunctionType, options: Mapping[str, Any], found: dict[str, str]) -> str:
    """Add the description of a function, and of all that it calls, to `found`; return its name."""
    name = _name(function)
    if name in found:
        return name
    found[name] = ""  # a function may call itself
    cells = [_described(cell.cell_contents, name, found) for cell in function.__closure__ or ()]
    used = sorted(
        {name_used for code in _codes(function.__code__) for name_used in code.co_names} & set(function.__globals__)
    )
    values = [
        (name_used, _described(function.__globals__[name_used], f"{name}: {name_used}", found)) for name_used in used
    ]
    codes = [_code(code, function.__doc__, name, found) for code in _codes(function.__code__)]
    defaults = _described(function.__defaults__, name, found)
    found[name] = repr((sorted(options.items()), defaults, cells, values, codes))
    return name


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield the code object of a function and those of functions defined inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _code(code: CodeType, doc: str | None, name: str, found: dict[str, str]) -> tuple[Any, ...]:
    """Return the content of a code object without line numbers, docstring and file name."""
    constants = [constant for constant in code.co_consts if not isinstance(constant, CodeType)]
    if doc is not None and constants[:1] == [doc]:
        constants[0] = None
    arguments = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    return code.co_code.hex(), [_described(constant, name, found) for constant in constants], arguments, names


def _described(value: Any, where: str, found: dict[str, str]) -> str:
    """Return a text that is different for different values."""
    if isinstance(value, Dispatcher):
        return _collect(value.py_func, value.targetoptions, found)
    if value is None or value is Ellipsis or isinstance(value, bool | int | float | complex | str | bytes):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, np.ndarray | np.generic):
        return f"{value.dtype.str} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, tuple):
        return f"{_name(type(value))} {[_described(item, where, found) for item in value]}"
    if isinstance(value, frozenset):
        return f"frozenset {sorted(_described(item, where, found) for item in value)}"
    if isinstance(value, type):
        return f"{_name(value)} {getattr(value, '_fields', ())}"
    module = getattr(value, "__name__" if isinstance(value, ModuleType) else "__module__", None) or ""
    if module.partition(".")[0] == "cuboid":
        if isinstance(value, FunctionType):
            return _collect(value, {}, found)
    elif isinstance(value, ModuleType):
        return module
    elif callable(value):  # of Python, NumPy or numba
        return f"{module}.{value.__name__}"
    raise TypeError(f"{where}: a kernel uses a {type(value).__name__}, of which no stamp can be made")


def _name(named: Any) -> str:
    return f"{named.__module__}.{named.__qualname__}"
