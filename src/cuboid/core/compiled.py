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

from cuboid.core import compiletime
from cuboid.core.kernelcache import KernelCache


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """A loop that is compiled by itself, not only inside others.

    Attributes
    ----------
    name : str
        Module and function.
    function : function
        Before it is compiled.
    cache : KernelCache
    """

    name: str
    function: FunctionType
    cache: KernelCache

    @property
    def cached(self) -> bool:
        """Whether machine code of it lies in the cache; not while its module is being imported, by another thread."""
        spec = sys.modules[self.function.__module__].__spec__
        return not getattr(spec, "_initializing", False) and self.cache.index.exists()

    @property
    def size(self) -> int:
        """Bytes of its code before it is compiled, about in proportion to the time that compiling takes."""
        return _size(self.function)


def _size(function: FunctionType) -> int:
    """Return the size of a function's code and of the code that becomes part of it."""
    used: list[Any] = [function.__globals__.get(name) for name in function.__code__.co_names]
    inlined = [one.py_func for one in used if getattr(one, "targetoptions", {}).get("inline") == "always"]
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
        Whether it becomes part of each kernel that calls it.
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
    """Passes numba's events on to `cuboid.core.compiletime`."""

    def on_start(self, event: Any) -> None:
        """Tell that a kernel begins to compile."""
        compiletime.begin()

    def on_end(self, event: Any) -> None:
        """Tell that a kernel is compiled."""
        compiletime.end()


event.register("numba:compile", _Compiling())
