"""The experiments behind the claims of the source paper, one by one.

python benchmarks/experiments.py NAME --work DIR [--data DATA] [--kinds KIND ...] [--seeds N ...] [--json]

NAME is one of

  descriptors  matching by IoU of boxes against matching by 3D features, as objects grow (--objects)
  resolution   accuracy and time at full, half and quarter resolution, and with every pixel
  sources      3D proposals and map with each source of 2D proposals, and with files in the layouts of MCG and CPMC
  frames       the map after so many frames, and of every n-th frame
  poses        fragments and identities against noise of the poses, with merging and without
  growth       time of each stage, memory, as the map grows by a new table each lap (--laps), and as time goes on
  memory       memory and time past ever more objects, with as much memory as --memory says
  corrections  time of a correction of poses, as the map grows by a new table each lap (--laps)
  scene        time until a large scene is opened again, and what a scene adds to the frames of scene 01
  guards       what it costs that files are checked as they are read, beside tracking a frame and evaluating a result
  proposals    boxes in the map of each scene of the suite
  peers        a pipeline made of Open3D (--peers-python), AB3DMOT's association, and this tracker, on the same frames

DIR keeps the made recordings; `--data DATA` adds scene 01 of RGB-D Scenes v2 (the folder that holds `rgbd-scenes-v2`).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cuboid import CuboidError
from cuboid.cli.synth import KINDS
from cuboid.ground.core.threads import limit_threads

NAMES = (
    "descriptors",
    "resolution",
    "sources",
    "frames",
    "poses",
    "growth",
    "memory",
    "corrections",
    "scene",
    "guards",
    "proposals",
    "peers",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=NAMES)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR")
    parser.add_argument("--data", type=Path, default=None, metavar="DATA")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=["table", "leave", "clutter"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[2], metavar="N")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="use each n-th frame")
    parser.add_argument("--limit", type=int, default=None, metavar="N", help="use at most so many frames")
    parser.add_argument("--laps", type=int, default=60, metavar="N", help="of growth; 1250 make 10,000 objects")
    parser.add_argument(
        "--objects", nargs="+", type=int, default=[10, 100, 1000], metavar="N", help="of descriptors and memory"
    )
    parser.add_argument("--memory", type=float, default=512.0, metavar="MB", help="of memory")
    parser.add_argument("--peers-python", default=None, metavar="PYTHON", help="of an environment that has Open3D")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="of proposals: scenes at a time")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    limit_threads(1)  # before anything imports NumPy
    from importlib import import_module

    try:
        import_module(f"experiment_{args.name}").run(args)
    except CuboidError as error:
        print(f"experiments: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
