"""Tables for people to read."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.table import Table

from cuboid.ground.core.errors import counted, printable
from cuboid.ground.core.skipped import kind_lines
from cuboid.ground.formats.folder import EVENTS

if TYPE_CHECKING:
    from cuboid.ground.core.results import TrackedObject
    from cuboid.results.files import RunReport, Timing
    from cuboid.results.files.rows import EventRow

# Width without a terminal: tables take the width they need, and no cell is cut.
UNCUT_WIDTH = 200

# A table that is too wide shortens its texts, but never to fewer characters than this.
TEXT_KEPT = 12

# Number of kinds of skipped frames that are shown; run.json has every frame.
KINDS_SHOWN = 8

# Number of events that are shown; events.csv has all.
EVENTS_PRINTED = 8


class _Console(Console):
    """A console on which escape codes in names have no effect."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print; escape unprintable characters of texts, and wrap the headings of a table that is too wide."""
        for item in objects:
            if (
                isinstance(item, Table)
                and self.measure(item, options=self.options.update(width=UNCUT_WIDTH)).maximum > self.width
            ):
                _wrap_headings(item)
        super().print(*(_lines(item) if isinstance(item, str) else item for item in objects), **options)

    def on_broken_pipe(self) -> None:
        """End the command as for any other output; Rich would exit with status 1."""
        raise BrokenPipeError


def _wrap_headings(table: Table) -> None:
    """Break the headings of a table into lines as wide as the cells below them; numbers are never cut."""
    for column in table.columns:
        cells = max((len(str(cell)) for cell in column.cells), default=1)
        words = textwrap.wrap(str(column.header), max(cells, 1), break_long_words=False)
        column.header = "\n".join(words)
        widest = max(cells, *map(len, words), 1)
        column.min_width = widest if column.justify == "right" else min(widest, TEXT_KEPT)


def _lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))


def console() -> Console:
    """Return the console of standard output; without a terminal it is plain text of `UNCUT_WIDTH` characters."""
    plain = _Console(highlight=False, markup=False, soft_wrap=True)
    return plain if plain.is_terminal else _Console(highlight=False, markup=False, width=UNCUT_WIDTH, no_color=True)


def new_table(*columns: str, left: int = 1) -> Table:
    """Return an empty table; the first `left` columns are text, the others numbers."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, header_style="bold")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i < left else "right", no_wrap=True)
    return table


def fits(table: Table, out: Console) -> bool:
    """Return whether a table fits into a console without cutting a cell; headings may be wrapped."""
    cells = [max((len(str(cell)) for cell in column.cells), default=1) for column in table.columns]
    words = [max(map(len, str(column.header).split()), default=1) for column in table.columns]
    return sum(max(pair) + 1 for pair in zip(cells, words, strict=True)) <= out.width


def sized_table(build: Callable[[str, bool], Table]) -> Table:
    """Return a table with sizes; in a narrow terminal without half their 95 % intervals.

    Parameters
    ----------
    build : callable
        Returns the table for the heading of the sizes, and whether half the interval is behind each.
    """
    from cuboid.results.files.object_table import SIZE_HEADING, SURE_SIZE_HEADING

    table = build(SURE_SIZE_HEADING, True)
    return table if fits(table, console()) else build(SIZE_HEADING, False)


def objects_table(objects: Iterable[TrackedObject]) -> Table:
    """Return the map of objects: label, size, position, frames seen, probability; in a narrow terminal without ±."""
    from cuboid.results.files.object_table import cells_of

    found = list(objects)
    name = ("name",) if any(item.name for item in found) else ()

    def build(size: str, errors: bool) -> Table:
        table = new_table("label", size, "position x, y, z (m)", "frames seen", "probability", *name, left=0)
        for item in found:
            cells = cells_of(item, errors=errors)
            table.add_row(str(item.label), *cells, *((printable(item.name or ""),) if name else ()))
        return table

    return sized_table(build)


def event_lines(events: Sequence[EventRow]) -> list[str]:
    """Return the lines about events of objects in view of the camera."""
    lines = []
    for one in events[:EVENTS_PRINTED]:
        far = "" if one.metres is None else f" {one.metres * 100:.0f} cm"
        lines.append(f"frame {one.frame}: object {one.label} {one.event}{far if one.event == 'moved' else ''}")
    if len(events) > EVENTS_PRINTED:
        lines.append(f"and {counted(len(events) - EVENTS_PRINTED, 'other event')}, in {EVENTS}")
    return lines


def furniture_lines(objects: Sequence[TrackedObject], furniture: Sequence[TrackedObject]) -> list[str]:
    """Return the lines about furniture: the numbers of objects and pieces, and the box and planes of each piece."""
    if not furniture:
        return []
    lines = [f"{counted(len(objects), 'object')}, {counted(len(furniture), 'piece')} of furniture:"]
    for item in furniture:
        planes = ", ".join(f"plane:{k}" for k in item.planes)
        lines.append(f"  #{item.label}: {item.box.text()}, bears {planes}")
    return lines


def score(value: float | None, digits: int = 3) -> str:
    """Return a number with so many digits; a dash if there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def timings_table(milliseconds: Mapping[str, Timing]) -> Table:
    """Return median and 95th percentile of each stage."""
    table = new_table("stage", "median ms", "p95 ms")
    for stage, timing in milliseconds.items():
        table.add_row(stage, f"{timing.median_ms:.2f}", f"{timing.p95_ms:.2f}")
    return table


def skipped_lines(report: RunReport) -> list[str]:
    """Return the lines about skipped frames, with their reasons."""
    if not report.skipped:
        return []
    kinds = report.skipped_kinds()
    lines = [f"{len(report.skipped)} of {report.frames_read} frames skipped:", *kind_lines(kinds[:KINDS_SHOWN])]
    if len(kinds) > KINDS_SHOWN:
        lines.append(f"  and {sum(kind.count for kind in kinds[KINDS_SHOWN:])} others")
    return lines


def detector_lines(milliseconds: Mapping[str, Sequence[float]]) -> list[str]:
    """Return the line about the time of the detector and its highest useful rate; no line without a detector."""
    from cuboid.runs.tracking.measuring import DETECTOR_BUDGET, DetectorCost

    cost = DetectorCost.of(milliseconds["frame"], milliseconds.get("detector", ()))
    if cost is None:
        return []
    line = (
        f"detector: {cost.detector_ms:.1f} ms; with it a frame takes {cost.mean_ratio:.2f} times as long on average, "
        f"{cost.median_ratio:.2f} times on median"
    )
    within = f"; --detector-every {cost.every} keeps the average within {DETECTOR_BUDGET}"
    return [line + (within if cost.mean_ratio > DETECTOR_BUDGET else "")]


def limit_lines(report: RunReport) -> list[str]:
    """Return the lines about limits that frames exceeded."""
    return [
        f"{counted(limit.frames, 'frame')} had more than {limit.most} {what}: {limit.left_out} of them were left out"
        for what, limit in report.limits.items()
    ]
