"""How a batch goes: recordings done and time left, and each failure as it happens."""

from __future__ import annotations

import sys
import time
from collections import Counter
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from cuboid.cli.progress import LINE_EVERY_S
from cuboid.core.errors import printable

if TYPE_CHECKING:
    from cuboid.batch.batch import Plan
    from cuboid.batch.task import Ended


class BatchProgress:
    """A bar on a terminal, elsewhere a line now and then; a context manager."""

    def __init__(self, planned: Plan, dashboard: str) -> None:
        self._planned = planned
        self._states: Counter[str] = Counter()
        self._frames = self._objects = 0
        self._console = Console(stderr=True)
        self._begun_s = self._last_s = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            TextColumn("time left"),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task("recordings", total=len(planned.tasks), state="")
        self._dashboard = dashboard

    def __enter__(self) -> BatchProgress:
        known = f"{self._planned.done} done before" + (
            f", {self._planned.failed} failed before" if self._planned.failed else ""
        )
        self._say(f"cuboid: {len(self._planned.tasks)} recordings to track, {known}; dashboard {self._dashboard}")
        for source, reason in self._planned.broken.items():
            self._say(f"cuboid: {source.name}: {reason}")
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def ended(self, one: Ended) -> None:
        """Take note of a recording that has ended."""
        self._states[one.state] += 1
        self._frames += one.frames
        self._objects += one.objects
        if one.reason is not None:
            self._say(f"cuboid: {one.head.recording}: {one.state}: {one.reason}")
        self._bar.update(self._task, advance=1, state=f"{self._objects} objects")
        self._line()

    def count(self, state: str) -> int:
        """Return how many recordings ended so."""
        return self._states[state]

    def figures(self) -> dict[str, Any]:
        """Return what was done, ready for JSON."""
        from cuboid.store.schema import DONE, FAILED, SET_ASIDE

        states = {state.replace(" ", "_"): self._states[state] for state in (DONE, FAILED, SET_ASIDE)}
        seconds = round(time.monotonic() - self._begun_s, 3)
        return {**states, "frames": self._frames, "objects": self._objects, "seconds": seconds}

    def summary(self, store: str) -> str:
        """Return the last line."""
        states = ", ".join(f"{count} {state}" for state, count in sorted(self._states.items())) or "nothing to do"
        broken = f", {len(self._planned.broken)} not listed" if self._planned.broken else ""
        before = f"; {self._planned.done} done before" if self._planned.done else ""
        found = f"{self._frames} frames, {self._objects} objects in {time.monotonic() - self._begun_s:.1f} s"
        return printable(f"{states}{broken}{before}; {found}; store {store}")

    def _line(self) -> None:
        now_s = time.monotonic()
        if self._console.is_terminal or now_s - self._last_s < LINE_EVERY_S:
            return
        self._last_s = now_s
        done, total = self._states.total(), len(self._planned.tasks)
        left_s = (now_s - self._begun_s) / done * (total - done)
        self._say(f"cuboid: {done} of {total} recordings, {self._objects} objects, about {duration(left_s)} left")

    def _say(self, line: str) -> None:
        if self._console.is_terminal:
            self._bar.console.print(printable(line), markup=False, highlight=False, soft_wrap=True)
        else:
            print(printable(line), file=sys.stderr, flush=True)


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
