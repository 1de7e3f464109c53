"""`cuboid compile`: compiles the kernels ahead of the first run."""

from __future__ import annotations

import argparse

HELP = "compile the kernels now, so that the first run need not"
EXAMPLE = "cuboid compile"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Nothing can be chosen: all kernels of tracking are compiled."""


def run(args: argparse.Namespace) -> int:
    """Compile, and say where the kernels are kept."""
    from cuboid.cli.progress import counting
    from cuboid.cli.threads import limit_threads

    limit_threads(1)
    from cuboid.warmup import compile_kernels

    with counting("tracking a made recording") as progress:
        compile_kernels(progress)
    from cuboid.compiled import KERNELS
    from cuboid.compiletime import compiling_s
    from cuboid.kernelcache import cache_folder

    done = sum(kernel.cache.compiled for kernel in KERNELS.values())
    there = sum(kernel.cached for kernel in KERNELS.values())
    print(f"{done} kernels compiled in {compiling_s():.0f} s; {there} of {len(KERNELS)} lie in {cache_folder()}")
    return 0
