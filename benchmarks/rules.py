"""Leave one rule out: by how much the figures over places are lower without each rule of the method.

python benchmarks/rules.py --work DIR [--data DATA] [--real DIR --real-truth DIR] [--only PLACE ...] [--seeds N ...]
                           [--rules NAME ...] [--together] [--jobs N] [--quick]

Each rule of `rule_patches.py` is left out alone in a copy of the source; with `--together` all named ones are left out
at once. Each copy tracks the places of `places.py`, whose options the others are, and the same judge judges it. A row
of the table gives the mean difference over places and its standard error, and the place that lost most.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import CuboidError
from cuboid.ground.core.threads import limit_threads
from place_tables import DECIDING, differences, mean_and_error
from place_tracking import Checkout
from places import add_options, chosen_places, drawn_seeds, render_all, tracked_rows
from rule_patches import RULES, Rule, write_variant
from scenes import SOURCE
from tables import markdown

FIGURES = {DECIDING: "F1", "recall": "recall", "precision": "precision", "hota": "HOTA"}


def main() -> int:
    args = _arguments()
    limit_threads(1)
    try:
        return _run(args)
    except CuboidError as error:
        print(f"rules: {error}", file=sys.stderr)
        return 2


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    names = [rule.name for rule in RULES]
    parser.add_argument("--rules", nargs="+", choices=names, default=names, metavar="NAME", help="default: all")
    parser.add_argument("--together", action="store_true", help="leave all of them out at once")
    return parser.parse_args()


def _run(args: argparse.Namespace) -> int:
    places, _ = chosen_places(args, drawn_seeds(args))
    rules = [rule for rule in RULES if rule.name in args.rules]
    left_out = [rules] if args.together else [[rule] for rule in rules]
    lines = []
    with ThreadPoolExecutor(args.jobs) as executor:
        unmade = render_all(places, executor)
        usual = tracked_rows(Checkout.of(SOURCE.parent, args.work), places, unmade, executor)
        for without in left_out:
            rows = tracked_rows(_variant(without, args.work), places, unmade, executor)
            lines.append(_line(without, differences(rows, usual)))
            print(" | ".join(lines[-1]), file=sys.stderr, flush=True)
    print(markdown(["without", "lines", "places", *FIGURES.values(), "largest loss of F1"], lines))
    return 0


def _variant(without: Sequence[Rule], work: Path) -> Checkout:
    """Write the copy of the source without some rules."""
    name = ", ".join(rule.name for rule in without)
    folder = work / "variants" / "".join(c if c.isalnum() else "-" for c in name)[:100]
    shutil.rmtree(folder, ignore_errors=True)
    write_variant(SOURCE, without, folder)
    return Checkout.of(folder, work)


def _line(without: Sequence[Rule], changes: Sequence[dict[str, Any]]) -> list[str]:
    """Return the row of a table: mean differences with standard errors, and the place that lost most."""
    head = [", ".join(rule.name for rule in without), str(sum(rule.lines for rule in without)), str(len(changes))]
    means = [mean_and_error([row[name] for row in changes if row.get(name) is not None]) for name in FIGURES]
    cells = ["-" if mean is None else f"{mean[0]:+.4f} ± {mean[1]:.4f}" for mean in means]
    losses = [(row[DECIDING], row["name"]) for row in changes if row.get(DECIDING) is not None]
    least, where = min(losses, default=(0.0, ""))
    return [*head, *cells, f"{least:+.3f} {where}" if least < 0 else "none"]


if __name__ == "__main__":
    sys.exit(main())
