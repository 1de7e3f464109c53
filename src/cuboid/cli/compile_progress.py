"""How far compiling the kernels is, for whoever waits for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from cuboid.core import compiletime

COMPILING = "compiling kernels"
# Seconds of compiling before the rest is estimated.
MIN_MEASURED_S = 5.0


class CompileCount:
    """Counts the kernels that are compiled and those that are still to be, and estimates the time that is left.

    Until all kernels of the imported modules are compiled nobody knows which of them this run needs: while fewer than
    half are missing, no total is given.
    """

    def __init__(self) -> None:
        self._known = 0
        self._missing: set[str] = set()

    def text(self) -> str:
        """Return what is compiled at the moment, such as "compiling kernels 37 of 119, about 40 s left"; else ""."""
        if not compiletime.compiling():
            return ""
        from cuboid.core.compiled import KERNELS

        if len(KERNELS) != self._known:  # another module was imported
            self._known = len(KERNELS)
            self._missing = {name for name, kernel in KERNELS.items() if not kernel.cached}
        done = [kernel for kernel in KERNELS.values() if kernel.cache.compiled]
        missing = [KERNELS[name] for name in self._missing if not KERNELS[name].cache.compiled]
        if 2 * (len(done) + len(missing)) < len(KERNELS) or not missing:
            return COMPILING
        left = sum(one.size for one in missing) / max(sum(one.size for one in done), 1)
        total = len(done) + len(missing)
        return f"{COMPILING} {min(len(done) + 1, total)} of {total}{about_left(compiletime.compiling_s(), left)}"


def about_left(spent_s: float, left: float) -> str:
    """Return in words how long the rest takes, where enough was measured to tell.

    Parameters
    ----------
    spent_s : float
        Seconds spent so far.
    left : float
        The work that is left, in units of the work that is done.
    """
    if spent_s < MIN_MEASURED_S:
        return ""
    left_s = spent_s * left
    if left_s > 90:
        return f", about {math.ceil(left_s / 60)} min left"
    return f", about {5 * math.ceil(left_s / 5)} s left"


@contextmanager
def showing_compilation(show: Callable[[str], None]) -> Iterator[None]:
    """Call `show` with how far compiling is whenever that changes, and with "" when the run goes on."""
    count, last = CompileCount(), ""

    def changed() -> None:
        nonlocal last
        text = count.text()
        if text != last:
            last = text
            show(text)

    with compiletime.listening(changed):
        yield
