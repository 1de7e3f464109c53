"""`cuboid compile`: compile the kernels ahead of the first run."""

from __future__ import annotations

import argparse
import time

from cuboid.ground.core.errors import OutputError

EXAMPLE = "cuboid compile"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    from cuboid.cli.results import add_results

    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Compile, and print how many kernels came with the installation, and how many are in the cache.

    Raises
    ------
    OutputError
        If kernels are missing and cannot be stored.
    """
    from cuboid.cli.progress import counting
    from cuboid.cli.results import give
    from cuboid.ground.compiling.compiled import KERNELS
    from cuboid.ground.compiling.kernelcache import VARIABLE, cache_folder, is_writable
    from cuboid.runs.pipeline.ahead import compile_all, listed_kernels

    begun_s = time.perf_counter()
    if not (all(kernel.cached for kernel in listed_kernels()) or is_writable()):
        raise OutputError(
            f"{cache_folder()}: compiled kernels cannot be stored here; name another folder in {VARIABLE}"
        )
    before = cached_count()
    with counting("kernels") as progress:
        compile_all(progress)
    done, seconds, folder = cached_count() - before, time.perf_counter() - begun_s, str(cache_folder())
    there = before + done
    installed = sum(kernel.cache.installed for kernel in KERNELS.values())
    document = {
        "compiled": done,
        "seconds": seconds,
        "cached": there,
        "installed": installed,
        "kernels": len(KERNELS),
        "folder": folder,
    }
    came = f"{installed} of {len(KERNELS)} kernels came with the installation, " if installed else ""
    line = f"{done} kernels compiled in {seconds:.0f} s; {came}{there - installed} of {len(KERNELS)} are in {folder}"
    give(args, document, lambda: print(line))
    return 0


def cached_count() -> int:
    """Return how many kernels of the imported modules are in the cache."""
    from cuboid.ground.compiling.compiled import KERNELS

    return sum(kernel.cached for kernel in KERNELS.values())
