"""`cuboid compile`: compile the kernels ahead of the first run."""

from __future__ import annotations

import argparse

EXAMPLE = "cuboid compile"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    from cuboid.cli.results import add_results

    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Compile, and print the folder of the kernels."""
    from cuboid.cli.progress import counting
    from cuboid.cli.results import give
    from cuboid.ground.core.threads import limit_threads

    limit_threads(1)
    from cuboid.runs.pipeline.warmup import compile_kernels

    with counting("tracking a made recording") as progress:
        compile_kernels(progress)
    from cuboid.ground.compiling.compiled import KERNELS
    from cuboid.ground.compiling.compiletime import compiling_s
    from cuboid.ground.compiling.kernelcache import cache_folder

    done = sum(kernel.cache.compiled for kernel in KERNELS.values())
    there = sum(kernel.cached for kernel in KERNELS.values())
    folder, seconds = str(cache_folder()), compiling_s()
    document = {"compiled": done, "seconds": seconds, "cached": there, "kernels": len(KERNELS), "folder": folder}
    line = f"{done} kernels compiled in {seconds:.0f} s; {there} of {len(KERNELS)} kernels are in {folder}"
    give(args, document, lambda: print(line))
    return 0
