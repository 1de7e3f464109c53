"""Progress of a run or of compiling: a bar on a terminal, elsewhere a line at intervals."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichBar

from cuboid.ground.compiling import compiletime
from cuboid.ground.compiling.compiletime import working_s
from cuboid.ground.core.errors import counted
from cuboid.ground.core.extras import COMPILED_INSTALL
from cuboid.ground.core.results import FrameResult
from cuboid.ground.core.threads import cores
from cuboid.runs.tracking.types import Progress

if TYPE_CHECKING:
    from cuboid.ground.compiling.compiled import Kernel

COMPILING = "compiling kernels"
# Processor time that compiling all listed kernels takes, seconds: 89 in a first run, measured on one core.
COMPILE_ALL_S = 90.0
# Seconds of compiling before the remaining time is estimated.
MIN_MEASURED_S = 5.0


class CompileCount:
    """Counts the compiled and the missing kernels, and estimates the remaining time.

    A run needs those kernels of the list (`cuboid.runs.pipeline.ahead`) whose modules are imported. If fewer than half
    of them are missing, no total is shown. Kernels that other processes compile count as well.
    """

    def __init__(self) -> None:
        self._kernel_count = 0
        self._missing: dict[str, Kernel] = {}

    def text(self) -> str:
        """Return the state of compiling, such as "compiling kernels 37 of 80, about 40 s left"; else ""."""
        if not compiletime.compiling():
            return ""
        from cuboid.ground.compiling.compiled import KERNELS
        from cuboid.runs.pipeline import ahead

        if len(KERNELS) != self._kernel_count:  # another module was imported
            self._kernel_count = len(KERNELS)
            self._listed = [KERNELS[name] for name in dict(ahead.listed()) if name in KERNELS]
            self._missing |= {kernel.name: kernel for kernel in self._listed if not kernel.cached}
        done = [kernel for kernel in self._missing.values() if kernel.cached]
        left = [kernel for kernel in self._missing.values() if not kernel.cached]
        total = len(self._missing)
        if 2 * total < len(self._listed) or not left:
            return COMPILING
        part = sum(one.size for one in left) / max(sum(one.size for one in done), 1)
        return f"{COMPILING} {len(done) + 1} of {total}{about_left(compiletime.compiling_s(), part)}"


def first_run_text(kernels: Sequence[Kernel], processes: int) -> str:
    """Return the line about a first run that compiles most kernels of the list; else "".

    Parameters
    ----------
    kernels : sequence of Kernel
        The kernels of the list.
    processes : int
        Number of processes that compile.
    """
    total = sum(kernel.size for kernel in kernels)
    missing = sum(kernel.size for kernel in kernels if not kernel.cached)
    if 2 * missing < total or not missing:
        return ""
    seconds = 5 * math.ceil(COMPILE_ALL_S * missing / total / processes / 5)
    return (
        f"the first run compiles Cuboid's kernels, once: about {seconds} s; they are kept for later runs "
        f"('{COMPILED_INSTALL}' in a checkout compiles them ahead)"
    )


def about_left(spent_s: float, left: float) -> str:
    """Return the remaining time in words; empty until enough was measured.

    Parameters
    ----------
    spent_s : float
        Seconds spent so far.
    left : float
        Remaining work, in units of the finished work.
    """
    if spent_s < MIN_MEASURED_S:
        return ""
    left_s = spent_s * left
    if left_s > 90:
        return f", about {math.ceil(left_s / 60)} min left"
    return f", about {5 * math.ceil(left_s / 5)} s left"


@contextmanager
def showing_compilation(show: Callable[[str], None]) -> Iterator[None]:
    """Call `show` with the state of compiling whenever it changes, and with "" when the run continues.

    If many kernels are missing, other processes help to compile them, one for each further core.
    """
    count, last = CompileCount(), ""

    def changed() -> None:
        nonlocal last
        text = count.text()
        if text != last:
            last = text
            show(text)

    with _helped(), compiletime.listening(changed):  # the line about a first run comes first
        yield


@contextmanager
def _helped() -> Iterator[None]:
    """Start helpers when the first kernel is compiled, if they are worth it."""
    begun = False
    with ExitStack() as helping:

        def begin() -> None:
            nonlocal begun
            if not begun:
                begun = True
                from cuboid.runs.pipeline import ahead

                count = ahead.useful_helpers(cores())
                told = first_run_text(ahead.listed_kernels(), 1 + count)
                if told:
                    print(f"cuboid: {told}", file=sys.stderr, flush=True)
                helping.enter_context(ahead.helpers(count))

        with compiletime.listening(begin):
            yield


# Seconds between lines of progress without a terminal: a log stays short, and still shows that the run proceeds.
LINE_EVERY_S = 10.0


class Bar:
    """A bar on the terminal."""

    def __init__(self, console: Console, what: str) -> None:
        done, state = MofNCompleteColumn(), TextColumn("{task.fields[state]}")
        columns = TextColumn("{task.description}"), BarColumn(), done, state, TimeRemainingColumn()
        self.context = RichBar(*columns, console=console, transient=True)
        self._task, self._state = self.context.add_task(what, total=None, state=""), ""

    def show(self, done: int, total: int | None, state: str = "") -> None:
        """Show how much is done, and the state beside it."""
        self._state = state
        self.context.update(self._task, completed=done, total=total, state=state)

    def compiling(self, text: str) -> None:
        """Show what is compiled in place of the state."""
        self.context.update(self._task, state=text or self._state, refresh=True)

    def print(self, line: str) -> None:
        """Print a line above the bar."""
        self.context.console.print(line, markup=False, soft_wrap=True)


class Lines:
    """Lines on standard error at intervals; a run that is shorter than the interval prints none."""

    def __init__(self, what: str, unit: str) -> None:
        self.context = nullcontext()
        self._what, self._unit, self._last_s, self._printed = what, unit, time.perf_counter(), False

    def show(self, done: int, total: int | None, state: str = "") -> None:
        """Print how much is done, if the interval since the last line, or since the beginning, is over."""
        count = f"{done}" if total is None else f"{done} of {total}"
        self._print_at_intervals(f"{count} {self._unit}, {state}" if state else f"{self._what}, {count}")

    def compiling(self, text: str) -> None:
        """Print what is compiled at intervals; the first time at once."""
        if text:
            self._print_at_intervals(text, at_once=not self._printed)

    def print(self, line: str) -> None:
        """Print a line."""
        print(line, file=sys.stderr, flush=True)

    def _print_at_intervals(self, text: str, *, at_once: bool = False) -> None:
        if at_once or time.perf_counter() - self._last_s >= LINE_EVERY_S:
            self._last_s, self._printed = time.perf_counter(), True
            self.print(f"cuboid: {text}")


@contextmanager
def display(what: str, console: Console, unit: str = "frames") -> Iterator[Bar | Lines]:
    """Show a bar on a terminal, lines elsewhere; both tell when kernels are compiled."""
    shown = Bar(console, what) if console.is_terminal else Lines(what, unit)
    with shown.context, showing_compilation(shown.compiling):
        yield shown


class _RunProgress(Progress):
    """Frames, frames per second without the first one, which loads the kernels, and the number of objects."""

    def __init__(self, shown: Bar | Lines) -> None:
        self._shown = shown
        self._total: int | None = None
        self._done = self._used = 0
        self._first_s, self._state = 0.0, ""

    def start(self, frames: int | None) -> None:
        """Store the number of frames."""
        self._total = frames
        self._shown.show(0, frames)

    def frame(self, result: FrameResult) -> None:
        """Count the frame."""
        now_s, objects = working_s(), counted(result.objects_known, "object")
        self._first_s = self._first_s if self._used else now_s
        rate = self._used / max(now_s - self._first_s, 1e-9)
        self._state = f"{rate:.0f} frames/s, {objects}" if self._used else objects
        self._used += 1
        self._advance()

    def skipped(self, index: int, reason: str) -> None:
        """Count the frame."""
        self._advance()

    def _advance(self) -> None:
        self._done += 1
        self._shown.show(self._done, self._total, self._state)

    def warning(self, line: str) -> None:
        """Print the line."""
        self._shown.print(f"cuboid: warning: {line}")


@contextmanager
def progress(console: Console | None = None) -> Iterator[Progress]:
    """Show the progress of a run, on standard error by default."""
    with display("tracking", console or Console(stderr=True)) as shown:
        yield _RunProgress(shown)


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress of other work; yields a function of the finished and the total number of parts."""
    with display(what, Console(stderr=True)) as shown:
        yield shown.show


def load_kernels() -> None:
    """Load the kernels before a live camera starts, or compile them, and show the progress."""
    from cuboid.runs.pipeline import ahead

    with counting("loading kernels") as shown:
        ahead.compile_all(shown)
