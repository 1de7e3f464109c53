"""How a run goes, on a terminal as a bar, elsewhere as a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from cuboid.cli.kernels import loaded_kernels
from cuboid.results import FrameResult
from cuboid.run_types import Progress

COMPILING = "compiling kernels (first run)"

# A line of progress after so many seconds where there is no terminal: a log stays short, and who watches
# it is not left alone.
LINE_EVERY_S = 10.0


class _Rate:
    """Frames and frames a second, the first frame left out: it pays for compiling."""

    def __init__(self) -> None:
        self.frames = 0
        self._first_s = 0.0

    def tick(self) -> float:
        now_s = time.perf_counter()
        if self.frames == 0:
            self._first_s = now_s
        self.frames += 1
        return (self.frames - 1) / max(now_s - self._first_s, 1e-9)


class TerminalProgress(Progress):
    """A bar with frames a second and the number of objects; a context manager."""

    def __init__(self, console: Console) -> None:
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._task = self._bar.add_task("tracking", total=None, state="")
        self._rate = _Rate()

    def __enter__(self) -> TerminalProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def start(self, frames: int | None) -> None:
        """Show the empty bar."""
        self._bar.update(self._task, total=frames, state=COMPILING if _compiling() else "")

    def frame(self, result: FrameResult) -> None:
        """Advance the bar."""
        rate = self._rate.tick()
        objects = _objects(result.objects_known)
        state = f"{rate:.0f} frames/s, {objects}" if self._rate.frames > 1 else objects
        self._bar.update(self._task, advance=1, state=state)

    def skipped(self, index: int, reason: str) -> None:
        """Advance the bar."""
        self._bar.update(self._task, advance=1)


class LineProgress(Progress):
    """A plain line every few seconds on standard error; a context manager."""

    def __init__(self) -> None:
        self._rate = _Rate()
        self._done = 0
        self._of = ""
        self._last_s = time.perf_counter()

    def __enter__(self) -> LineProgress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left to tidy."""

    def start(self, frames: int | None) -> None:
        """Note how many frames there are."""
        self._of = "" if frames is None else f" of {frames}"
        if _compiling():
            print(f"cuboid: {COMPILING}", file=sys.stderr, flush=True)

    def frame(self, result: FrameResult) -> None:
        """Print a line where the last one is long ago."""
        self._done += 1
        rate, now_s = self._rate.tick(), time.perf_counter()
        if now_s - self._last_s >= LINE_EVERY_S:
            self._last_s = now_s
            done = f"{self._done}{self._of} frames"
            print(
                f"cuboid: {done}, {rate:.0f} frames/s, {_objects(result.objects_known)}",
                file=sys.stderr,
                flush=True,
            )

    def skipped(self, index: int, reason: str) -> None:
        """Count the frame."""
        self._done += 1


def progress() -> TerminalProgress | LineProgress:
    """Return what fits standard error."""
    console = Console(stderr=True)
    return TerminalProgress(console) if console.is_terminal else LineProgress()


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show how far some other work is, on a terminal only; gives a function of what is done and of all."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _compiling() -> bool:
    """Tell whether most kernels are still to be compiled, which takes long enough to be said."""
    kernels = loaded_kernels()
    return 2 * sum(not kernel.cached for kernel in kernels) > len(kernels)


def _objects(count: int) -> str:
    return f"{count} object{'' if count == 1 else 's'}"
