"""Keep the figures of the benchmarks in `results.json`, and write the tables of README.md and BENCHMARK.md from it.

python benchmarks/results.py [--places FILE] [--bench FILE] [--peers FILE ...] [--measures FILE]

Each option takes what another command wrote, in place of what `results.json` has of it:

  places.py --save FILE
  cuboid bench DATA/rgbd-scenes-v2 --threads 1 --json FILE
  experiments.py peers --json > FILE  (the cases of several files are joined)
  measures.py > FILE

Without options it writes the tables again. In the pages they stand between `<!-- figures: NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import CuboidError, InputError
from place_figures import FIGURES
from place_list import DATA, FURTHER
from place_tables import made, real, reliability_table, stills, summary_table, worst
from scoring import mean, total
from tables import cell, markdown

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).with_name("results.json")
PAGES = (REPOSITORY / "README.md", REPOSITORY / "BENCHMARK.md")
FORMAT, VERSION = "cuboid-results", 1
MARKED = re.compile(r"<!-- figures: (.+?) -->\n.*?<!-- end -->", re.DOTALL)
SCENE_01 = "rgbd-scenes-v2"
ABOUT = {place.name: place.about for place in (*DATA, *FURTHER)}
OURS = "Cuboid"
# The systems of the README's table.
BESIDE = (OURS, "AB3DMOT on Cuboid's boxes", "Open3D pipeline")
# Figures of all peers: name in the results, heading, digits.
PEER_FIGURES = (
    ("recall_50", "recall", 3),
    ("precision_50", "precision", 3),
    ("mean_iou", "mean IoU", 3),
    ("hota", "HOTA", 3),
    ("idf1_25", "IDF1", 3),
    ("ms_frame", "ms a frame", 1),
)
PEER_COUNTS = (("proposals", "labels"), ("objects", "objects"), ("switches", "switches"), ("fragments", "fragments"))
TAIL = (("median", "median"), ("p99", "99th percentile"), ("worst", "worst"))

Document = dict[str, Any]


def main() -> int:
    """Take new figures into the results, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", type=Path, default=None, metavar="FILE")
    parser.add_argument("--bench", type=Path, default=None, metavar="FILE")
    parser.add_argument("--peers", type=Path, nargs="+", default=[], metavar="FILE")
    parser.add_argument("--measures", type=Path, default=None, metavar="FILE")
    args = parser.parse_args()
    try:
        document = load() if RESULTS.exists() else {"format": FORMAT, "version": VERSION}
        take(document, args)
        RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        tables = tables_of(document)
        for page in PAGES:
            page.write_text(with_tables(page.read_text(encoding="utf-8"), tables), encoding="utf-8")
    except CuboidError as error:
        print(f"results: {error}", file=sys.stderr)
        return 2
    return 0


def load(path: Path = RESULTS) -> Document:
    """Read the results.

    Raises
    ------
    InputError
        If the file is no results file of this version.
    """
    document: Document = json.loads(path.read_text(encoding="utf-8"))
    if (document.get("format"), document.get("version")) != (FORMAT, VERSION):
        raise InputError(f"{path}: expected format {FORMAT}, version {VERSION}")
    return document


def take(document: Document, args: argparse.Namespace) -> None:
    """Put what the options name into the results."""
    if args.places is not None:
        document["places"] = _read(args.places, "places")
    if args.bench is not None:
        bench = _read(args.bench, "tail")
        document["bench"] = {name: bench[name] for name in ("tail", "milliseconds", "peak_memory_mb", "map", "machine")}
    if args.peers:
        found = [_read(path, OURS) for path in args.peers]
        document["peers"] = {name: [row for one in found for row in one[name]] for name in found[0]}
    if args.measures is not None:
        document["measures"] = table_of(args.measures.read_text(encoding="utf-8"))


def _read(path: Path, key: str) -> Document:
    try:
        document: Document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error})") from error
    if key not in document:
        raise InputError(f"{path}: has no '{key}': written by another command?")
    return document


def table_of(text: str) -> list[dict[str, str]]:
    """Return the rows of the first table in a text, each as cells by the heading of their column."""
    lines = [line.strip().strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    if len(lines) < 3:
        raise InputError("expected a table with rows")
    header, _, *rows = [[part.strip() for part in line] for line in lines]
    return [dict(zip(header, row, strict=True)) for row in rows if row != header]


def with_tables(page: str, tables: Mapping[str, Callable[[], str]]) -> str:
    """Return a page with the tables of the results at its marks."""

    def table(found: re.Match[str]) -> str:
        if found[1] not in tables:
            raise InputError(f"no table is called '{found[1]}'; there are {', '.join(tables)}")
        return f"<!-- figures: {found[1]} -->\n\n{tables[found[1]]()}\n\n<!-- end -->"

    return MARKED.sub(table, page)


def tables_of(document: Document) -> dict[str, Callable[[], str]]:
    """Return what makes each table of the pages, by its name."""
    rows = document["places"]["places"]
    return {
        "places in short": lambda: short_places(rows),
        "scene 01 beside peers": lambda: scene_01(rows, document["peers"], document["bench"]),
        "summary": lambda: summary_table(rows),
        "real places": lambda: real_places([*real(rows), *stills(rows)]),
        "made kinds": lambda: made_kinds(rows),
        "reliability": lambda: reliability_table([*real(rows), *stills(rows)]),
        "speed": lambda: speed(document["bench"]),
        "stages": lambda: stages(document["bench"]),
        "measures": lambda: measures(document["measures"]),
        "peers": lambda: peers(document["peers"]),
    }


def short_places(rows: Sequence[Document]) -> str:
    """Return mean and worst of the real places in percent."""
    places = real(rows)
    names = {"recall": "objects found (recall)", "precision": "labels that are right (precision)"}
    names |= {"one_label": "found objects that keep one label"}
    lines = []
    for name, heading in names.items():
        value, place = worst(places, name).rstrip(")").split(" (")
        lines.append([heading, _percent(mean(places, name)), f"{_percent(float(value))}: {ABOUT.get(place, place)}"])
    return markdown([f"{len(places)} real places", "mean", "worst"], lines)


def real_places(rows: Sequence[Document]) -> str:
    """Return the figures of real places, without AP."""
    names = [name for name in FIGURES if name != "ap"]
    lines = [
        [row["name"], row["kind"], f"{row['iou']:g}".lstrip("0"), str(row["wanted"]), *(row[name] for name in names)]
        for row in rows
    ]
    return markdown(["place", "kind", "IoU", "to find", *(FIGURES[name] for name in names)], lines)


def made_kinds(rows: Sequence[Document]) -> str:
    """Return the main figures of made kinds."""
    names = ("recall", "precision", "f1", "one_label", "idf1", "hota")
    lines = [
        [row["name"].removeprefix("made "), str(row["wanted"]), *(row[name] for name in names)] for row in made(rows)
    ]
    return markdown(["kind", "to find", *(FIGURES[name] for name in names)], lines)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def scene_01(rows: Sequence[Document], peers: Mapping[str, Sequence[Document]], bench: Document) -> str:
    """Return the figures of the table objects of scene 01, beside those of peers."""
    ours = next(row for row in rows if row["name"] == SCENE_01)["boxes"]
    columns = {name: next(row for row in peers[name] if row["scene"] == "scene 01") for name in BESIDE}
    times = {name: row["ms_frame"] for name, row in columns.items()} | {OURS: bench["tail"]["median_ms"]}
    columns[OURS] = ours
    lines = [["objects found at IoU 0.5", *(f"{_found(row)} of {row['objects']}" for row in columns.values())]]
    for name, heading in (("switches", "label switches"), ("proposals", "labels given in the whole room")):
        lines.append([heading, *(str(row[name]) for row in columns.values())])
    for name, heading in (("mean_iou", "mean IoU of the boxes"), ("hota", "HOTA")):
        lines.append([heading, *(cell(row[name], 2) for row in columns.values())])
    lines.append(["time of a frame, median (AB3DMOT: association alone)", *(f"{ms:.0f} ms" for ms in times.values())])
    return markdown(["", *columns], lines)


def _found(row: Document) -> int:
    return round(row["recall_50"] * row["objects"])


def peers(found: Mapping[str, Sequence[Document]]) -> str:
    """Return the figures of all systems over all cases: means, and sums of counts; and the names of the cases."""
    header = ["system", *(heading for _, heading in PEER_COUNTS), *(heading for _, heading, _ in PEER_FIGURES)]
    lines = [
        [
            name,
            *(str(total(rows, count)) for count, _ in PEER_COUNTS),
            *(cell(mean(rows, figure), digits) for figure, _, digits in PEER_FIGURES),
        ]
        for name, rows in found.items()
    ]
    cases = ", ".join(row["scene"] for row in found[OURS])
    return f"{markdown(header, lines)}\n\nMeans and sums over: {cases}."


def speed(bench: Document) -> str:
    """Return the times of a frame in milliseconds and in units of decoding its images."""
    tail, points = bench["tail"], bench["map"]
    lines = [[name, f"{tail[f'{key}_ms']:.1f} ms", f"{tail[f'{key}_decodes']:.1f}"] for key, name in TAIL]
    lines.append(["decoding", f"{tail['decode_ms']:.1f} ms", "1"])
    lines.append(["highest memory of the process", f"{bench['peak_memory_mb']:.0f} MB", ""])
    lines.append(["map, a point", f"{points['bytes_per_point']:.0f} bytes", ""])
    return markdown([f"{bench['machine']['cpu']}, one thread", "", "units of decoding"], lines)


def stages(bench: Document) -> str:
    """Return the time of each stage in one sentence."""
    times = ((name, time) for name, time in bench["milliseconds"].items() if name != "frame")
    parts = (f"{name} {time['median']:.1f} ({time['p95']:.1f})" for name, time in times)
    return ",\n".join(["Stages, median and 95th percentile in milliseconds", *parts]) + "."


def measures(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the rows of the sizes of made parcels that are over all sensors."""
    some = [row for row in rows if row["sensor"] == "all"]
    header = [name for name in some[0] if name != "sensor"]
    return markdown(header, [[row[name] for name in header] for row in some])


if __name__ == "__main__":
    sys.exit(main())
