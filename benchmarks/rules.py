"""Leave one rule out: the figures of the tracker without each rule of the method.

python benchmarks/rules.py --data DATA --work WORK [--rules NAME ...] [--together]
    [--sets SET ...] [--seeds N ...] [--noises N] [--jobs N] [--table]

Each rule of `rule_patches.py` is left out alone in a copy of the source; with `--together` all named ones are left out
at once. Each copy tracks all sets of `rule_sets.py`: real recordings in DATA and made ones, which WORK keeps.
`--noises` says how many more runs the unchanged source gets on depth with a little more noise: their spread is chance.
Figures go to WORK/results.jsonl as they come, and what is there is not measured again; `--table` only prints them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rule_patches import RULES, Rule, write_variant
from tables import cell, markdown

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "src" / "cuboid"
BASE = "all rules"
# Sets that one process tracks one after the other; those first in which the most different things are seen.
REAL_GROUPS = (("desk", "bin-robot-hand", "dish"), ("office", "hots"), ("fr1-xyz",), ("scene-01",))
KINDS = ("bin", "counter", "shelf", "clutter", "overhead", "tables", "stacks", "table", "room", "occluders", "leave")
SEEDS = (1, 2)
FIGURES = ("HOTA", "IDF1", "recall", "precision")


@dataclass(frozen=True, slots=True)
class Job:
    """One process: a copy of the source on a group of sets.

    Attributes
    ----------
    variant : str
        Name of the copy.
    sets : tuple of str
    noise : int or None
        Seed of the noise that is added.
    """

    variant: str
    sets: tuple[str, ...]
    noise: int | None


def variants_of(rules: list[Rule], together: bool) -> dict[str, list[Rule]]:
    """Return the rules that each copy of the source is without, by its name."""
    if together:
        return {"without " + ", ".join(rule.name for rule in rules): rules}
    return {rule.name: [rule] for rule in rules}


def folder_of(work: Path, variant: str) -> Path:
    """Return the folder of a copy of the source."""
    return work / "variants" / "".join(c if c.isalnum() else "-" for c in variant)[:100]


def run_job(job: Job, source: Path, data: Path, work: Path, lines: Path) -> None:
    """Measure, and add what was found to a file."""
    noise = [] if job.noise is None else ["--noise", str(job.noise)]
    command = [sys.executable, str(HERE / "rule_sets.py"), *job.sets, "--data", str(data), "--work", str(work), *noise]
    path = os.pathsep.join([str(source), os.environ.get("PYTHONPATH", "")])
    begun_s = time.monotonic()
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
    line: dict[str, Any] = {"variant": job.variant, "sets": list(job.sets), "noise": job.noise}
    line["seconds"] = round(time.monotonic() - begun_s, 1)
    if done.returncode == 0:
        line["rows"] = json.loads(done.stdout.splitlines()[-1])
    else:
        line["error"] = done.stderr[-2000:]
    with lines.open("a") as file:
        file.write(json.dumps(line) + "\n")


def jobs_of(variants: list[str], groups: list[tuple[str, ...]], noises: int) -> list[Job]:
    """Return all jobs: each group of sets by all copies before the next one, so that what is done can be compared."""
    jobs = []
    for group in groups:
        jobs += [Job(BASE, group, noise) for noise in (None, *range(1, noises + 1))]
        jobs += [Job(variant, group, None) for variant in variants]
    return jobs


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return what was measured so far, without what failed."""
    if not path.exists():
        return []
    return [line for text in path.read_text().splitlines() if "rows" in (line := json.loads(text))]


def summed_up(row: dict[str, Any]) -> dict[str, float]:
    """Return the four figures of a row; those at two IoUs are means of both."""
    pairs = {"HOTA": ("hota",), **{n: (f"{n.lower()}_25", f"{n.lower()}_50") for n in FIGURES[1:]}}
    known = {name: [row[key] for key in keys if row.get(key) is not None] for name, keys in pairs.items()}
    return {name: float(np.mean(values)) for name, values in known.items() if values}


def table(lines: list[dict[str, Any]]) -> str:
    """Return the table: by how much each figure is higher without a rule, on the sets that both have.

    The first line is the spread (root mean square) of the same differences where only the noise of depth is another.
    """
    found: dict[tuple[str, int | None], dict[str, dict[str, float]]] = defaultdict(dict)
    for line in lines:
        for row in line["rows"]:
            found[line["variant"], line["noise"]][row["name"]] = summed_up(row)
    usual = found[BASE, None]
    spread = [_differences(rows, usual) for (variant, noise), rows in found.items() if variant == BASE and noise]
    lines_of = {rule.name: rule.lines for rule in RULES}
    body = []
    if spread:
        chance = {key: _deviation([one[key] for one in spread]) for key in spread[0]}
        body.append(["chance", "", len(usual), *_cells(chance)])
    for (variant, noise), rows in found.items():
        if variant != BASE and noise is None:
            body.append([variant, lines_of.get(variant, ""), len(rows), *_cells(_differences(rows, usual))])
    header = ["without", "lines", "sets", *(f"{part} {name}" for part in ("made", "real") for name in FIGURES)]
    return markdown([*header, "least real"], body)


def _differences(rows: dict[str, dict[str, float]], usual: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Return the mean differences of the figures of made and of real sets, and the real set that lost most."""
    by: dict[str, list[float]] = defaultdict(list)
    worst = (0.0, "")
    for name, values in rows.items():
        part = "made" if name.split("-")[0] in KINDS and " " not in name else "real"
        for key in values.keys() & usual.get(name, {}).keys():
            difference = values[key] - usual[name][key]
            by[f"{part} {key}"].append(difference)
            if part == "real":
                worst = min(worst, (difference, f"{name} {key}"))
    keys = [f"{part} {key}" for part in ("made", "real") for key in FIGURES]
    return {key: float(np.mean(by[key])) if by[key] else None for key in keys} | {"least": worst}


def _deviation(values: list[Any]) -> Any:
    if isinstance(values[0], tuple):
        return min(values)
    known = [value for value in values if value is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def _cells(differences: dict[str, Any]) -> list[str]:
    *figures, (least, where) = differences.values()
    return [*(cell(value) for value in figures), f"{least:.3f} {where}"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--rules", nargs="*", default=None, metavar="NAME", help="default: all")
    parser.add_argument("--together", action="store_true", help="leave all of them out at once")
    parser.add_argument("--sets", nargs="+", default=None, metavar="SET", help="default: all")
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS, metavar="N", help="of made recordings")
    parser.add_argument("--noises", type=int, default=3, metavar="N")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N")
    parser.add_argument("--table", action="store_true")
    args = parser.parse_args()
    lines = args.work / "results.jsonl"
    if not args.table:
        by_name = {rule.name: rule for rule in RULES}
        unknown = [name for name in args.rules or () if name not in by_name]
        if unknown:
            parser.error(f"no rule is called '{unknown[0]}'; there are: {', '.join(by_name)}")
        rules = list(RULES) if args.rules is None else [by_name[name] for name in args.rules]
        variants = variants_of(rules, args.together) if rules else {}
        made_groups = [tuple(f"{kind}-{seed}" for seed in args.seeds) for kind in KINDS]
        groups = [tuple(args.sets)] if args.sets else [*REAL_GROUPS, *made_groups]
        measure(variants, groups, args, lines)
    print(table(read_lines(lines)))
    return 0


def measure(
    variants: dict[str, list[Rule]], groups: list[tuple[str, ...]], args: argparse.Namespace, lines: Path
) -> None:
    """Do all jobs that were not done yet."""
    for name, rules in {BASE: [], **variants}.items():
        folder = folder_of(args.work, name)
        if not folder.exists():
            write_variant(SOURCE, rules, folder)
    done = {(line["variant"], tuple(line["sets"]), line["noise"]) for line in read_lines(lines)}
    jobs = [
        job for job in jobs_of(list(variants), groups, args.noises) if (job.variant, job.sets, job.noise) not in done
    ]
    with ThreadPoolExecutor(args.jobs) as pool:
        for job in jobs:
            pool.submit(run_job, job, folder_of(args.work, job.variant), args.data, args.work, lines)


if __name__ == "__main__":
    sys.exit(main())
