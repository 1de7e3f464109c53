"""Every place, real and made, in one table: a change of the method is taken or refused by it.

python benchmarks/places.py --work DIR [--data DATA] [--real DIR --real-truth DIR] [--quick] [--jobs N]
                            [--seeds N ...] [--against CHECKOUT|FILE] [--leave-out KIND ...] [--save FILE]

DATA and `--real` hold the real recordings, `--real-truth` the rectangles of those in `--real`; a place that is absent
is named and left out. Made places are a scene of each kind of `cuboid synth` for each seed; without `--seeds` the seeds
are drawn and printed. `docs/evaluation.md` defines the figures.

Each recording is tracked by `cuboid track RECORDING --threads 1` without further options. `--work` keeps the results by
the digest of the program's source, and made recordings by that of the generator: a second call is quick.
`--against` compares with another checkout, whose results the same judge judges, or with a file of `--save`. `--quick`
takes one seed and one still in four. `results.py` writes the tables of README.md and BENCHMARK.md from such a file.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import CuboidError, InputError
from cuboid.ground.core.threads import limit_threads
from place_figures import place_row
from place_list import Folders, Place, made_places, named, real_places, render
from place_tables import (
    differences,
    differences_table,
    means_table,
    places_table,
    reliability_table,
    summary_table,
    verdict,
)
from place_tracking import Checkout, track
from scenes import SOURCE

FORMAT, VERSION = "cuboid-places", 1
# Seeds that are drawn: beyond those that the suite and the tests use.
FIRST_SEED, LAST_SEED = 1000, 9999
# Stills of which one is taken, and number of drawn seeds: with and without `--quick`.
QUICK_EVERY_STILL, QUICK_SEEDS, SEEDS = 4, 1, 2


def main() -> int:
    args = _arguments()
    limit_threads(1)
    try:
        return _run(args)
    except CuboidError as error:
        print(f"places: {error}", file=sys.stderr)
        return 2


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    parser.add_argument("--against", type=Path, default=None, metavar="CHECKOUT|FILE")
    parser.add_argument("--leave-out", nargs="+", default=[], metavar="KIND", help="kinds or places not in the verdict")
    parser.add_argument("--save", type=Path, default=None, metavar="FILE", help="write all figures as JSON")
    return parser.parse_args()


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which places are tracked, and where results are kept."""
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps recordings and results")
    parser.add_argument("--data", type=Path, default=None, metavar="DATA", help="real recordings with their truth")
    parser.add_argument("--real", type=Path, default=None, metavar="DIR", help="further real recordings")
    parser.add_argument("--real-truth", type=Path, default=None, metavar="DIR", help="rectangles of these recordings")
    parser.add_argument("--quick", action="store_true", help="one seed, and one still in four")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes")
    parser.add_argument("--seeds", nargs="*", type=int, default=None, metavar="N", help="of made places")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these places or kinds of places")


def _run(args: argparse.Namespace) -> int:
    earlier = _earlier(args.against)
    seeds = list(earlier["seeds"]) if earlier is not None and args.seeds is None else drawn_seeds(args)
    places, absent = chosen_places(args, seeds)
    print(f"seeds of made places: {' '.join(map(str, seeds)) or 'none'}")
    if absent:
        print(f"absent, and left out: {', '.join(absent)}")
    with ThreadPoolExecutor(args.jobs) as executor:
        unmade = render_all(places, executor)
        rows = tracked_rows(Checkout.of(SOURCE.parent, args.work), places, unmade, executor)
        tables = (table(rows) for table in (summary_table, places_table, means_table, reliability_table))
        print("", *tables, sep="\n\n", flush=True)
        other = None if earlier is None else earlier["places"]
        if args.against is not None and other is None:
            other = tracked_rows(Checkout.of(args.against / "src", args.work), places, unmade, executor)
    if args.save is not None:
        document = {"format": FORMAT, "version": VERSION, "seeds": seeds, "places": rows}
        args.save.write_text(json.dumps(document, indent=1), encoding="utf-8")
    if other is not None:
        _compare(rows, other, args.leave_out)
    return 0


def drawn_seeds(args: argparse.Namespace) -> list[int]:
    """Return the seeds of made places: those asked for, or fresh ones."""
    if args.seeds is not None:
        return list(args.seeds)
    span = LAST_SEED - FIRST_SEED + 1
    return sorted(FIRST_SEED + secrets.randbelow(span) for _ in range(QUICK_SEEDS if args.quick else SEEDS))


def chosen_places(args: argparse.Namespace, seeds: Sequence[int]) -> tuple[list[Place], list[str]]:
    """Return the places that the options name, and the names of real ones that are absent."""
    folders = Folders(args.data, args.real, args.real_truth, args.work)
    real, absent = real_places(folders, QUICK_EVERY_STILL if args.quick else 1)
    places = list(named([*real, *made_places(seeds, args.work)], args.only))
    if not places:
        raise InputError("there is no place to judge")
    return places, absent


def _earlier(against: Path | None) -> dict[str, Any] | None:
    """Return the seeds and places that an earlier call saved; None if `against` is a checkout or was not given."""
    if against is None or (against / "src" / "cuboid").is_dir():
        return None
    if not against.is_file():
        raise InputError(f"{against}: expected a checkout with src/cuboid, or a file written by --save")
    try:
        document = json.loads(against.read_text(encoding="utf-8"))
        if (document["format"], document["version"]) == (FORMAT, VERSION):
            return {"seeds": list(document["seeds"]), "places": list(document["places"])}
    except (ValueError, KeyError, TypeError):
        pass
    raise InputError(f"{against}: is no file written by --save (format {FORMAT}, version {VERSION})")


def render_all(places: Sequence[Place], executor: ThreadPoolExecutor) -> dict[str, str]:
    """Make the recordings of made places; return the reasons of failures by place."""
    parts = [(place, part) for place in places for part in place.parts if part.synth]
    reasons = executor.map(render, [part for _, part in parts])
    return {place.name: reason for (place, _), reason in zip(parts, reasons, strict=True) if reason is not None}


def tracked_rows(
    checkout: Checkout, places: Sequence[Place], unmade: dict[str, str], executor: ThreadPoolExecutor
) -> list[dict[str, Any]]:
    """Track all places with a checkout, and judge them; return the rows in the order of the places."""
    begin = time.monotonic()
    rows = {place.name: place_row(place, checkout, unmade[place.name]) for place in places if place.name in unmade}
    for place, failure in track(checkout, [place for place in places if place.name not in unmade], executor):
        rows[place.name] = place_row(place, checkout, failure)
        said = failure or "judged"
        print(
            f"{len(rows)}/{len(places)} {place.name}: {said}, {time.monotonic() - begin:.0f} s",
            file=sys.stderr,
            flush=True,
        )
    return [rows[place.name] for place in places]


def _compare(rows: Sequence[dict[str, Any]], earlier: Sequence[dict[str, Any]], left_out: Sequence[str]) -> None:
    changes = differences(rows, earlier)
    uncompared = sorted({row["name"] for row in rows} - {row["name"] for row in changes})
    print(f"\nThis version minus the other:\n\n{differences_table(changes)}\n")
    if uncompared:
        print(f"not compared (failed, or other recordings): {', '.join(uncompared)}")
    print(verdict(changes, left_out))


if __name__ == "__main__":
    sys.exit(main())
