"""The figures of README.md and BENCHMARK.md are those of the results file that the benchmarks write."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pytest

import results
from cuboid.ground.core.errors import InputError
from results import MARKED, PAGES, load, table_of, tables_of, take, with_tables

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_tables_of_a_page_are_those_of_the_results(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == with_tables(text, tables_of(load())), "run `python benchmarks/results.py`"


def test_each_table_of_the_results_is_on_one_page() -> None:
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    shown = [found[1] for text in texts for found in MARKED.finditer(text)]
    assert sorted(shown) == sorted(tables_of(load()))
    assert sum(text.count("<!-- figures: ") for text in texts) == len(shown)


def test_the_results_are_of_all_places_and_none_failed() -> None:
    rows = load()["places"]["places"]
    assert [row["name"] for row in rows if "failed" in row] == []
    assert len(results.real(rows)) == 13
    assert len(results.stills(rows)) == 2
    assert len(results.made(rows)) > 15


def place(name: str, recall: float, kind: str = "desk", made: bool = False) -> dict[str, Any]:
    figures = dict.fromkeys(("precision", "f1", "ap", "one_label", "idf1", "hota", "calibration"), 0.5)
    counts = {"wanted": 4, "found": 2, "false": 2}
    return {"name": name, "kind": kind, "iou": 0.5, "made": made, **counts, "recall": recall, **figures}


def test_the_worst_place_is_named_for_readers() -> None:
    rows = [
        place("cafe", 0.75),
        place("mini_shelf", 0.25),
        place("hots", 0.1, "stills"),
        place("made bin", 0.0, made=True),
    ]
    table = results.short_places(rows)
    assert "| 2 real places | mean | worst |" in table
    assert "| objects found (recall) | 50 % | 25 %: groceries in a carton on its side |" in table


def test_the_summary_separates_real_places_stills_and_made_kinds() -> None:
    rows = [
        place("a", 0.2),
        place("b", 0.4),
        place("c", 0.6),
        place("s", 0.9, "stills"),
        place("made bin", 0.8, made=True),
    ]
    lines = results.summary_table(rows).splitlines()[2:]
    assert [line.split(" | ")[:3] for line in lines] == [
        ["| real places, mean", "3", "0.400 ± 0.115"],
        ["| ... the worst", "", "0.200 (a)"],
        ["| sets of stills, mean", "1", "0.900"],
        ["| made kinds, mean", "1", "0.800"],
    ]


def test_figures_that_commands_wrote_replace_earlier_ones(tmp_path: Path) -> None:
    options: dict[str, Any] = dict.fromkeys(("places", "bench", "measures"))
    files = [tmp_path / "a.json", tmp_path / "b.json"]
    for k, path in enumerate(files):
        path.write_text(json.dumps({"Cuboid": [{"scene": k}], "Open3D pipeline": [{"scene": k}]}))
    document: dict[str, Any] = {"peers": {}}
    take(document, argparse.Namespace(**options, peers=files))
    assert document["peers"]["Open3D pipeline"] == [{"scene": 0}, {"scene": 1}]
    with pytest.raises(InputError, match=r"a\.json: has no 'places'"):
        take(document, argparse.Namespace(**{**options, "places": files[0]}, peers=[]))


def test_a_printed_table_is_read_by_its_headings() -> None:
    assert table_of("said before\n| view | error |\n|---|---|\n| above | 0.2 |\n") == [
        {"view": "above", "error": "0.2"}
    ]
    with pytest.raises(InputError, match="expected a table"):
        table_of("nothing\n")


def test_empty_marks_are_filled_each_for_itself() -> None:
    page = "".join(f"<!-- figures: {name} -->\n\n<!-- end -->\n\ntext\n" for name in "ab")
    tables = {"a": lambda: "| 1 |", "b": lambda: "| 2 |"}
    filled = with_tables(page, tables)
    assert filled.count("text") == 2
    assert "<!-- figures: a -->\n\n| 1 |\n\n<!-- end -->" in filled
    assert with_tables(filled, tables) == filled


def test_a_mark_without_a_table_is_an_error() -> None:
    with pytest.raises(InputError, match="no table is called 'colors'"):
        with_tables("<!-- figures: colors -->\n\nold\n\n<!-- end -->", {})
