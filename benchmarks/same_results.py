"""Whether two checkouts give the same results, byte for byte.

python benchmarks/same_results.py --data DATA --work DIR [--fast] [--jobs N] [--threads N] [--save FILE]
                                  [--against WHAT] [NAME ...]

Tracks short pieces of the real recordings in DATA and of made ones, with given and estimated poses, with a scene and
without; each call of `cuboid track` is a process of its own. SHA-256 digests of the result files are saved as JSON.
With `--against`, another checkout, or digests that were saved before, is compared, and every file that differs is
printed; the exit status is 1 then. `--threads` is the number of threads of this checkout; the other one has one
thread. A NAME picks the runs whose names contain it ("table-1", "/estimated/scene").

A run with a scene has two recordings of it, the second a later visit: "first/objects.json", "second/objects.json"; and
what `cuboid scene changes` prints.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = ("objects.json", "tracks.csv", "proposals.csv", "trajectory.txt", "map.ply")
Digests = dict[str, dict[str, str]]
# Frames of a hots still, which is one image: the same one again and again.
STILL_FRAMES = 6


@dataclass(frozen=True, slots=True)
class Sample:
    """A recording, and the piece of it that is tracked.

    Attributes
    ----------
    name : str
    path : str
        Under DATA; of a made one the options of `cuboid synth`; of a still the name of its files.
    limit : int
        Frames that are read.
    poses : tuple of str
        Which of "given" and "estimated" are possible.
    options : tuple of str
        Of `cuboid track`.
    fast : tuple of str
        Endings of the runs that `--fast` takes.
    """

    name: str
    path: str
    limit: int
    poses: tuple[str, ...] = ("given", "estimated")
    options: tuple[str, ...] = ()
    fast: tuple[str, ...] = ()


EVERY_5 = ("--every", "5")
REAL = (
    Sample("scene-01", "rgbd-scenes-v2/imgs/scene_01", 60, options=EVERY_5, fast=("given/scene", "estimated/plain")),
    Sample("fr1-xyz", "rgbd_dataset_freiburg1_xyz", 40, options=("--every", "3")),
    Sample("desk-realsense", "desk-realsense", 50, fast=("given/plain",)),
    Sample("office-scan", "office-scan", 30),
    Sample("dish-from-above", "dish-from-above", 40, ("estimated",)),
    Sample("overhead-hands", "overhead-hands", 55, fast=("given/plain",)),
    Sample("bin-robot-hand", "bin-robot-hand", 15, fast=("given/plain",)),
    Sample("open3d", "containers/open3d", 30),
    Sample("record3d", "containers/record3d-exr", 20),
)
STILLS = tuple(
    Sample(f"hots-{name}", name, STILL_FRAMES, ("given",))
    for name in ("mix_1_top_raw_0", "office_9_top_raw_1", "table_8_top_raw_0")
)
SMALL = "--size 320x240 --frames 60"
MADE = (
    Sample("table-1", f"--kind table --seed 1 {SMALL}", 60, fast=("given/scene", "estimated/scene")),
    Sample("occluders-2", f"--kind occluders --seed 2 {SMALL}", 60),
    Sample("leave-3", f"--kind leave --seed 3 {SMALL}", 60, fast=("given/plain",)),
    Sample("tables-4", f"--kind tables --seed 4 {SMALL}", 60),
    Sample("clutter-5", f"--kind clutter --seed 5 {SMALL} --pose-noise drift", 60, fast=("given/plain",)),
    Sample("room-6", f"--kind room --seed 6 {SMALL} --motion handheld", 60),
    Sample("visits-7", f"--kind table --seed 7 --visits 2 {SMALL}", 60, fast=("given/scene",)),
    Sample("tof-8", f"--kind clutter --seed 8 {SMALL} --sensor time-of-flight --motion drone", 60),
)


@dataclass(frozen=True, slots=True)
class Run:
    """A sample tracked in one way: poses are "given" or "estimated", into is "plain" or "scene"."""

    sample: Sample
    poses: str
    into: str

    @property
    def ending(self) -> str:
        """Poses and whether there is a scene: "given/scene"."""
        return f"{self.poses}/{self.into}"

    @property
    def name(self) -> str:
        """A name that no other run has."""
        return f"{self.sample.name}/{self.ending}"


def all_runs() -> list[Run]:
    """Return every run."""
    return [
        Run(sample, poses, into)
        for sample in (*REAL, *STILLS, *MADE)
        for poses in sample.poses
        for into in ("plain", "scene")
    ]


def call(checkout: Path, *arguments: object) -> str:
    """Run the command line of a checkout, with one thread in each library, and return what it prints."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    done = subprocess.run(
        [sys.executable, "-m", "cuboid", *map(str, arguments)],
        env={**os.environ, **threads, "PYTHONPATH": str(checkout / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"cuboid {' '.join(map(str, arguments))}: {done.stderr.strip()[-1000:]}")
    return done.stdout


def recordings_of(sample: Sample, data: Path, work: Path) -> list[Path]:
    """Return the recordings of a sample, first and second visit; made ones are kept in `work`."""
    if sample in REAL:
        return [data / sample.path] * 2
    folder = work / "recordings" / sample.name
    if not folder.exists():
        partial = folder.with_suffix(".partial")
        shutil.rmtree(partial, ignore_errors=True)
        if sample in STILLS:
            _still(sample, data / "hots", partial)
        else:
            partial.parent.mkdir(parents=True, exist_ok=True)
            call(ROOT, "synth", "--output", partial, "--workers", 1, *sample.path.split())
        partial.rename(folder)
    visits = sorted(folder.glob("visit-*"))
    return visits or [folder] * 2


def _still(sample: Sample, hots: Path, folder: Path) -> None:
    """Make a recording of one image again and again, whose camera stands still."""
    for kind, ending in (("color", "jpg"), ("depth", "png")):
        (folder / kind).mkdir(parents=True)
        for k in range(sample.limit):
            shutil.copyfile(hots / f"{sample.path}.{kind}.{ending}", folder / kind / f"{k:06d}.{ending}")
    rows = [line.split() for line in (hots / "camera-intrinsics.txt").read_text().splitlines()]
    numbers = {"fx": rows[0][0], "fy": rows[1][1], "cx": rows[0][2], "cy": rows[1][2]}
    camera: dict[str, float] = {name: float(number) for name, number in numbers.items()}
    camera |= {"width": 640, "height": 480, "depth_units_per_metre": 1000}
    (folder / "camera.json").write_text(json.dumps(camera))
    (folder / "poses.txt").write_text("".join(f"{k} 0 0 0 0 0 0 1\n" for k in range(sample.limit)))


def digests_of(run: Run, recordings: list[Path], checkout: Path, folder: Path, threads: int) -> dict[str, str]:
    """Return the digest of each result file of a run, by name."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    scene, found = folder / "run.cuboid", {}
    common = ("--limit", run.sample.limit, "--threads", threads, "--poses", run.poses, *run.sample.options)
    try:
        if run.into == "plain":
            call(checkout, "track", recordings[0], "--output", folder / "out", *common)
            return _digests(folder / "out", "")
        for visit, recording in zip(("first", "second"), recordings, strict=True):
            same = ("--same-world",) if run.poses == "given" else ()
            call(checkout, "track", recording, "--output", folder / visit, "--scene", scene, *same, *common)
            found |= _digests(folder / visit, f"{visit}/")
        return {**found, "changes": _digest(call(checkout, "scene", "changes", scene, "--all").encode())}
    except RuntimeError as error:  # a recording may be refused: by both checkouts in the same words
        said = str(error).replace(str(folder), "").splitlines()[-1]
        return {**found, "error": said}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _digests(folder: Path, prefix: str) -> dict[str, str]:
    return {prefix + name: _digest((folder / name).read_bytes()) for name in FILES if (folder / name).exists()}


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def measure(runs: list[Run], checkout: Path, data: Path, work: Path, jobs: int, threads: int = 1) -> Digests:
    """Return the digests of runs of a checkout, by name of the run."""
    recordings = {run.sample.name: recordings_of(run.sample, data, work) for run in runs}
    # The first run is alone: it compiles the kernels for all others.
    with ThreadPoolExecutor(jobs) as pool:

        def one(run: Run) -> dict[str, str]:
            place = work / "results" / str(os.getpid()) / run.name.replace("/", "-")
            begun = time.perf_counter()
            found = digests_of(run, recordings[run.sample.name], checkout, place, threads)
            print(f"{run.name}: {time.perf_counter() - begun:.0f} s {found.get('error', '')}", file=sys.stderr)
            return found

        first = one(runs[0])
        rest = pool.map(one, runs[1:])
        return {run.name: found for run, found in zip(runs, (first, *rest), strict=True)}


def differences(here: Digests, there: Digests) -> list[str]:
    """Return a line for each file of a run that is not the same; runs that only one side has are left out."""
    return [
        f"{run}: {name} differs"
        for run in sorted(here.keys() & there.keys())
        for name in sorted(here[run].keys() | there[run].keys())
        if here[run].get(name) != there[run].get(name)
    ]


def main() -> int:
    """Print the files that differ; return 1 where there are any."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("CUBOID_DATA", ROOT.parent / "shared" / "data"))
    parser.add_argument("--work", type=Path, required=True, help="folder for made recordings and results")
    parser.add_argument("--fast", action="store_true", help="a few runs")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    parser.add_argument("--threads", type=int, default=1, help="threads of a run of this checkout")
    parser.add_argument("--save", type=Path, help="file for the digests of this checkout")
    parser.add_argument("--against", type=Path, help="another checkout, or saved digests")
    parser.add_argument("names", nargs="*", metavar="NAME", help="parts of names of runs")
    options = parser.parse_args()
    runs = [run for run in all_runs() if not options.names or any(name in run.name for name in options.names)]
    runs = [run for run in runs if not options.fast or run.ending in run.sample.fast]
    if not runs:
        parser.error("no run has such a name")
    data, work = Path(options.data).resolve(), options.work.resolve()
    here = measure(runs, ROOT, data, work, options.jobs, options.threads)
    if options.save:
        options.save.write_text(json.dumps(here, indent=1) + "\n")
    if options.against is None:
        return 0
    if options.against.is_dir():
        there = measure(runs, options.against.resolve(), data, work, options.jobs)
    else:
        there = json.loads(options.against.read_text())
    lines = differences(here, there)
    print("\n".join(lines) or f"{len(here.keys() & there.keys())} runs: no file differs")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
