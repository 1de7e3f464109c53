"""Which of the compiled loops lie ready in the cache, and where."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Kernel:
    """A compiled loop.

    Attributes
    ----------
    name : str
        Module and function.
    cached : bool
        Whether machine code of it lies in the cache.
    folder : Path
        The cache.
    """

    name: str
    cached: bool
    folder: Path


def loaded_kernels() -> list[Kernel]:
    """Return the kernels of all modules of this package that are imported so far, by name."""
    from numba.core.dispatcher import Dispatcher

    found: dict[str, Kernel] = {}
    for module_name, module in sorted(sys.modules.items()):
        if module_name.startswith("cuboid."):
            for item in vars(module).values():
                if isinstance(item, Dispatcher) and _compiled_in(item, module_name):
                    kernel = _kernel(module_name, item)
                    found[kernel.name] = kernel
    return [found[name] for name in sorted(found)]


def _compiled_in(dispatcher: Any, module_name: str) -> bool:
    """Tell whether a kernel is of this module and compiled by itself, not only inside others."""
    own = dispatcher.py_func.__module__ == module_name
    return bool(own and dispatcher.targetoptions.get("inline") != "always")


def _kernel(module_name: str, dispatcher: Any) -> Kernel:
    folder = Path(dispatcher.stats.cache_path or ".")
    function = dispatcher.py_func
    index = f"{module_name.rpartition('.')[2]}.{function.__qualname__}-{function.__code__.co_firstlineno}.*.nbi"
    return Kernel(f"{module_name}.{function.__qualname__}", any(folder.glob(index)), folder)
