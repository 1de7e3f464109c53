"""Tables on a terminal of usual width: headings wrap, numbers are whole."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table

from cuboid.cli import tables
from cuboid.cli.tables import EVENTS_PRINTED, event_lines, new_table, sized_table
from cuboid.results.files.rows import EventRow

HEADINGS = ("map, IoU", "precision", "recall", "F1", "AP", "found", "wrong", "mean IoU", "centre off", "size off")
CELLS = ("0.25", "1.000", "0.875", "0.933", "0.870", "7 of 8", "12", "0.863", "10.74 cm", "0.70 cm")


def printed(table: Table, width: int) -> str:
    screen = io.StringIO()
    tables._Console(file=screen, width=width, color_system=None, soft_wrap=True).print(table)
    return screen.getvalue()


@pytest.mark.parametrize("width", [200, 80, 60])
def test_no_number_is_cut_on_a_narrow_terminal(width: int) -> None:
    table = new_table(*HEADINGS)
    table.add_row(*CELLS)
    shown = printed(table, width)
    assert "…" not in shown
    assert all(cell in shown for cell in CELLS)
    assert ("mean IoU" in shown) == (width == 200)  # headings wrap where there is no room


def test_the_figures_of_an_evaluation_fit_80_columns() -> None:
    table = new_table(*HEADINGS)
    table.add_row(*CELLS)
    assert max(map(len, printed(table, 80).splitlines())) <= 80


def test_events_are_told_in_lines_and_many_are_counted() -> None:
    here, there = np.zeros(3), np.array([0.3, 0.4, 0.0])
    moved = EventRow("moved", 3, here, there, 0.9, 120, 4.0)
    gone = EventRow("gone", 1, here, None, 1.0, 300, 10.0)
    assert event_lines([moved, gone]) == ["frame 120: object 3 moved 50 cm", "frame 300: object 1 gone"]
    lines = event_lines([gone] * 20)
    assert len(lines) == EVENTS_PRINTED + 1
    assert lines[-1] == "and 12 other events, in events.csv"


@pytest.mark.parametrize(("columns", "interval"), [(80, True), (24, False)])
def test_a_table_of_sizes_has_no_intervals_where_the_terminal_is_narrow(
    monkeypatch: pytest.MonkeyPatch, columns: int, interval: bool
) -> None:
    def build(size: str, errors: bool) -> Table:
        table = new_table("label", size)
        table.add_row("1", "12.3 ± 0.4 x 12.3 ± 0.4 x 12 ± 2" if errors else "12.3 x 12.3 x 12")
        return table

    monkeypatch.setattr(tables, "console", lambda: Console(width=columns))
    assert ("±" in next(iter(sized_table(build).columns[1].cells))) == interval
