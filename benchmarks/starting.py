"""How long the program takes to start, with compiled kernels: the help, a tracker, and a tracker's first frame.

python benchmarks/starting.py [--times N] [--json]

Each figure is the median of so many new processes. The goals: help 0.25 s, tracker 2 s.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

from tables import dump, markdown

TRACKER = f"""
import sys
sys.path.append({str(Path(__file__).parent)!r})
import cuboid
from warm_up import CAMERA, WarmUpRecording
tracker = cuboid.Tracker(CAMERA)
"""
FRAME = "tracker.update(WarmUpRecording().read(0))"
CALLS = {
    "cuboid --help": ["-m", "cuboid", "--help"],
    "import cuboid; cuboid.Tracker(...)": ["-c", TRACKER],
    "and its first frame": ["-c", TRACKER + FRAME],
}


def seconds(words: list[str]) -> float:
    begun_s = time.perf_counter()
    subprocess.run([sys.executable, *words], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begun_s


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=7, metavar="N")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args()
    found = {}
    for name, words in CALLS.items():
        seconds(words)  # compiles, and brings the files into memory
        found[name] = round(median(seconds(words) for _ in range(args.times)), 3)
    if args.json:
        dump(found)
    else:
        print(markdown(("start", "seconds"), [[name, value] for name, value in found.items()]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
