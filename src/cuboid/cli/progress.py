"""Progress of a run or of compiling: a bar on a terminal, elsewhere a line at intervals."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

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


class _Rate:
    """Number of frames, and frames per second without the first frame, which loads the kernels."""

    def __init__(self) -> None:
        self.frames = 0
        self._first_s = 0.0

    def tick(self) -> float:
        now_s = working_s()
        if self.frames == 0:
            self._first_s = now_s
        self.frames += 1
        return (self.frames - 1) / max(now_s - self._first_s, 1e-9)


def _bar(console: Console) -> Bar:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
    )
    return Bar(*columns, console=console, transient=True)


class _Shown(Progress):
    """Context manager: what it shows begins and ends with it."""

    def __init__(self) -> None:
        self._rate, self._shown = _Rate(), ExitStack()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._shown.close()


class TerminalProgress(_Shown):
    """Context manager: a bar with frames per second and the number of objects."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self._bar = _bar(console)
        self._task = self._bar.add_task("tracking", total=None, state="")
        self._state = ""

    def __enter__(self) -> Self:
        self._shown.enter_context(self._bar)
        self._shown.enter_context(showing_compilation(self._compiling))
        return self

    def start(self, frames: int | None) -> None:
        """Show the empty bar."""
        self._bar.update(self._task, total=frames)

    def frame(self, result: FrameResult) -> None:
        """Advance the bar."""
        rate = self._rate.tick()
        objects = counted(result.objects_known, "object")
        self._state = f"{rate:.0f} frames/s, {objects}" if self._rate.frames > 1 else objects
        self._bar.update(self._task, advance=1, state=self._state)

    def skipped(self, index: int, reason: str) -> None:
        """Advance the bar."""
        self._bar.update(self._task, advance=1)

    def warning(self, line: str) -> None:
        """Print the line above the bar."""
        self._bar.console.print(f"cuboid: warning: {line}", markup=False, soft_wrap=True)

    def _compiling(self, text: str) -> None:
        self._bar.update(self._task, state=text or self._state, refresh=True)


class _Lines:
    """Lines on standard error at intervals; a run that is shorter than the interval prints none."""

    def __init__(self) -> None:
        self._last_s = time.perf_counter()
        self._printed = False

    def print(self, text: str) -> None:
        """Print the text if the interval since the last line, or since the beginning, is over."""
        if text and time.perf_counter() - self._last_s >= LINE_EVERY_S:
            self._print(text)

    def print_soon(self, text: str) -> None:
        """Print the text, also before the first interval is over."""
        if text and not self._printed:
            self._print(text)
        self.print(text)

    def _print(self, text: str) -> None:
        self._last_s, self._printed = time.perf_counter(), True
        print(f"cuboid: {text}", file=sys.stderr, flush=True)


class LineProgress(_Shown):
    """Context manager: a plain line every few seconds on standard error."""

    def __init__(self) -> None:
        super().__init__()
        self._done = 0
        self._of = ""
        self._lines = _Lines()

    def __enter__(self) -> Self:
        self._shown.enter_context(showing_compilation(self._lines.print_soon))
        return self

    def start(self, frames: int | None) -> None:
        """Store the number of frames."""
        self._of = "" if frames is None else f" of {frames}"

    def frame(self, result: FrameResult) -> None:
        """Count the frame; print a line if the interval is over."""
        self._done += 1
        rate = self._rate.tick()
        self._lines.print(
            f"{self._done}{self._of} frames, {rate:.0f} frames/s, {counted(result.objects_known, 'object')}"
        )

    def skipped(self, index: int, reason: str) -> None:
        """Count the frame."""
        self._done += 1

    def warning(self, line: str) -> None:
        """Print the line."""
        print(f"cuboid: warning: {line}", file=sys.stderr, flush=True)


def progress() -> TerminalProgress | LineProgress:
    """Return the progress display that suits standard error."""
    console = Console(stderr=True)
    return TerminalProgress(console) if console.is_terminal else LineProgress()


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress of other work; yields a function of the finished and the total number of parts."""
    console = Console(stderr=True)
    with ExitStack() as shown:
        if not console.is_terminal:
            lines = _Lines()
            shown.enter_context(showing_compilation(lines.print_soon))
            yield lambda done, total: lines.print(f"{what}, {done} of {total}")
            return
        bar = shown.enter_context(_bar(console))
        task = bar.add_task(what, total=None, state="")
        shown.enter_context(showing_compilation(lambda text: bar.update(task, state=text, refresh=True)))
        yield lambda done, total: bar.update(task, completed=done, total=total)


def load_kernels() -> None:
    """Load the kernels before a live camera starts, or compile them, and show the progress."""
    from cuboid.runs.pipeline import warmup

    with counting("loading kernels") as shown:
        warmup.load_kernels(shown)
