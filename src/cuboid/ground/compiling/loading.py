"""Compiled kernels from their files, without what only the compilation of a kernel needs.

Before numba loads a function, it imports its versions of the functions of Python and NumPy (and with them SciPy's
linear algebra), and compiles its reference counting; and it keeps the intermediate code of each function that it loads,
for functions that are compiled later and call it. All this takes a second and 90 MB for the kernels of a run. Here,
the first part happens when a kernel is compiled (numba does it then), and intermediate code is parsed when it is used.
"""

from __future__ import annotations

import pickle
from functools import cache
from importlib import import_module
from typing import Any

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import compile_result
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime._nrt_python import c_helpers


class KernelFile(IndexDataCacheFile):
    """The files of a kernel; reading one imports no module of numba that is not loaded."""

    def _load_data(self, name: str) -> Any:
        with open(self._data_path(name), "rb") as file:
            return _Unpickler(file).load()


class KernelResults(CompileResultCacheImpl):
    """The content of a kernel's file, and the step from it to a callable kernel."""

    def reduce(self, compiled: Any) -> Any:
        """Return the content of the file: numba's, without the source text with types."""
        library, description, environment, signature, objectmode, lifted, _, *more = super().reduce(compiled)
        return (library, description, environment, signature, objectmode, lifted, "", *more)

    def rebuild(self, target_context: Any, content: Any) -> Any:
        """Return the callable kernel."""
        library, description, environment, signature, objectmode, lifted, _, reload_init, environments = content
        for initialise in reload_init:
            initialise()
        _register_runtime()
        codegen = target_context.codegen()
        loaded = LoadedKernel(codegen, library, description.llvm_cpython_wrapper_name)
        function = target_context.get_executable(loaded, description, environment)
        for one in environments:
            codegen.set_env(one.env_name, one)
        return compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            entry_point=function,
            signature=signature,
            objectmode=objectmode,
            lifted=lifted,
            fndesc=description,
            library=loaded,
            environment=environment,
            reload_init=reload_init,
            referenced_envs=environments,
        )


class LoadedKernel(JITCodeLibrary):
    """The machine code of a kernel, and its intermediate code, which is parsed when a kernel that calls it is compiled.

    Parameters
    ----------
    codegen : numba.core.codegen.JITCPUCodegen
    content : tuple
        What `serialize_using_object_code` returned: name, "object", machine code with intermediate code.
    symbol : str
        Name of the function that Python calls.
    """

    def __init__(self, codegen: Any, content: tuple[str, str, tuple[bytes, bytes]], symbol: str) -> None:
        name, _, (machine_code, self._intermediate_code) = content
        super().__init__(codegen, name)
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        codegen._engine._defined_symbols.add(symbol)

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = binding.parse_bitcode(self._intermediate_code)
        return self._shared_module


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Return a class or a function of the file."""
        if (module, name) == ("numba.core.environment", "_rebuild_env"):
            return _environment
        return super().find_class(module, name)


def _environment(module: str, constants: list[Any], name: str) -> Any:
    """Return the objects that compiled code refers to; code of numba itself refers to none of its module's."""
    found = lookup_environment(name)
    if found is None:
        of_numba = module.partition(".")[0] == "numba"
        found = Environment({"__name__": module} if of_numba else import_module(module).__dict__)
        found.consts[:] = constants
        found.env_name = name
        Environment._memo[name] = found
    return found


@cache
def _register_runtime() -> None:
    """Tell LLVM the addresses of the functions of numba's memory management; compiled code calls them by name."""
    for name, address in c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
