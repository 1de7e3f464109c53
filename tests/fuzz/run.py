"""Fuzz for long: ``python tests/fuzz/run.py [TARGET ...] [--inputs N] [--seed N]``.

Each new fault is said, and its first input is kept in ``tests/fuzz/kept``, where the tests find it.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from containers import CONTAINERS, NEEDS  # noqa: E402
from engine import fuzz, keep_faults, quiet_libraries  # noqa: E402
from scene_files import SCENES  # noqa: E402
from store_files import STORES  # noqa: E402
from targets import TARGETS as OWN  # noqa: E402

TARGETS = {**OWN, **SCENES, **STORES, **CONTAINERS}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)} (default: all)")
    parser.add_argument("--inputs", type=int, default=10_000, help="for each target (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="default: the time")
    parser.add_argument("--calls", type=int, help="calls for each input, drawn at random (default: all)")
    parser.add_argument("--no-keep", action="store_true", help="keep no cases")
    args = parser.parse_args()
    quiet_libraries()
    faults = 0
    for name in args.targets or TARGETS:
        if name in NEEDS and find_spec(NEEDS[name]) is None:
            print(f"{name}: left out, for {NEEDS[name]} is not installed", flush=True)
            continue
        begun_s = time.perf_counter()
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            outcome = fuzz(TARGETS[name], Path(folder), args.inputs, args.seed, args.calls)
        faults += len(outcome.faults)
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        print(
            f"{name}: {outcome.inputs} inputs, {outcome.calls} calls, {outcome.refused} refused, "
            f"{len(outcome.faults)} faults, slowest {outcome.slowest_s:.2f} s, {peak_mb} MB, "
            f"{time.perf_counter() - begun_s:.0f} s (seed {args.seed})",
            flush=True,
        )
        for fault, count in outcome.counts.most_common():
            print(f"  {count:5d} x {fault} ({outcome.faults[fault][0]})", flush=True)
        if not args.no_keep:
            for path in keep_faults(outcome, name, HERE / "kept"):
                print(f"  kept: {path.relative_to(HERE.parents[1])}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
