"""Tables on a terminal of usual width: headings wrap, numbers are whole."""

from __future__ import annotations

import io

import pytest
from rich.table import Table

from cuboid.cli import tables
from cuboid.cli.tables import new_table

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
