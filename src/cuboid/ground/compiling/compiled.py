"""The decorator of all kernels: hot loops on flat arrays that numba compiles when they are first called.

::

    @kernel
    def centre(points, out): ...

    @kernel(error_model="numpy")
    def inverse_depth(depth_m, out): ...
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Literal

from numba import njit
from numba.core import event

from cuboid.ground.compiling import compiletime
from cuboid.ground.compiling.kernelcache import KernelCache


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """A kernel that is compiled on its own, not only inlined into others.

    Attributes
    ----------
    name : str
        Module and function, joined by a point.
    function : function
        The Python function before compilation.
    cache : KernelCache
    """

    name: str
    function: FunctionType
    cache: KernelCache

    @property
    def cached(self) -> bool:
        """Whether its machine code is on disk; False while another thread still imports its module."""
        spec = sys.modules[self.function.__module__].__spec__
        return not getattr(spec, "_initializing", False) and (self.cache.installed or self.cache.index.exists())

    @property
    def size(self) -> int:
        """Size of its bytecode in bytes; compile time is roughly proportional to it."""
        return _size(self.function)


def _size(function: FunctionType) -> int:
    """Return the bytecode size of a function and of the kernels that are inlined into it, bytes."""
    used: list[Any] = [function.__globals__.get(name) for name in function.__code__.co_names]
    inlined = [item.py_func for item in used if getattr(item, "targetoptions", {}).get("inline") == "always"]
    return len(function.__code__.co_code) + sum(map(_size, inlined))


ErrorModel = Literal["python", "numpy"]
Inline = Literal["never", "always"]

# All kernels of the modules that are imported so far, by name.
KERNELS: dict[str, Kernel] = {}


def kernel(function: Any = None, /, *, error_model: ErrorModel = "python", inline: Inline = "never") -> Any:
    """Let numba compile a function when it is first called, and keep its machine code on disk.

    Parameters
    ----------
    function : function
    error_model : {"python", "numpy"}
        Whether a division by zero raises or gives infinity.
    inline : {"never", "always"}
        Whether the kernel is inlined into each kernel that calls it.
    """
    if function is None:
        return lambda function: _compiled(function, error_model, inline)
    return _compiled(function, error_model, inline)


def _compiled(function: FunctionType, error_model: ErrorModel, inline: Inline) -> Any:
    dispatcher: Any = njit(nogil=True, error_model=error_model, inline=inline)(function)
    if inline == "always" or not hasattr(dispatcher, "targetoptions"):  # numba's switch for debugging gives a function
        return dispatcher
    store = dispatcher._cache = KernelCache(function, dispatcher.targetoptions)
    name = f"{function.__module__}.{function.__qualname__}"
    KERNELS[name] = Kernel(name, function, store)
    return dispatcher


class _Compiling(event.Listener):
    """Forwards numba's compile events to `cuboid.ground.compiling.compiletime`."""

    def on_start(self, event: Any) -> None:
        """Report that numba begins to compile a kernel."""
        compiletime.begin()

    def on_end(self, event: Any) -> None:
        """Report that numba has compiled a kernel."""
        compiletime.end()


event.register("numba:compile", _Compiling())
