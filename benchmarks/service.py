"""How fast a served place answers, and what that costs a run: HTTP and MCP on many objects, asked while a run goes on.

python benchmarks/service.py --work DIR [--objects N] [--clients N] [--rounds N] [--json]

A made recording is tracked again and again, in turn: alone; beside servers of results with N objects, which clients in
a process of their own ask (what the machine's cores share); and served itself, with N made objects more than it finds,
asked by the same clients. Each client asks five times a second; those over MCP always ask the results.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
from mcp.client.client import Client

from cuboid import open_recording
from cuboid.cli.serving import HOST, listen
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import MapPoints, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.results.files import ObjectsFile, ResultWriter, RunReport, Timing
from cuboid.runs.pipeline.options import RunHooks
from cuboid.runs.pipeline.run import track_recording
from cuboid.services.service.process import ServedRun
from scenes import Case, cases
from tables import dump, show

FIRST = 100_000  # labels of made objects
ASK_EVERY_S = 0.2
STARTING_S = 5.0  # until the processes are there
FRAMES, WARM_UP_FRAMES = 300, 50
SPACING_M = 0.25
QUESTIONS = {
    "name": lambda rng, labels: {"name": f"thing {rng.choice(labels) % 50}"},
    "near a point": lambda rng, labels: {"near": f"{rng.uniform(0, 20)},{rng.uniform(0, 20)},0", "within": "0.5"},
    "near an object": lambda rng, labels: {"near_object": rng.choice(labels)},
    "size": lambda rng, labels: {"min_size": "0.1", "max_size": "0.12"},
    "on an object": lambda rng, labels: {"on": rng.choice(labels)},
}


def made_objects(count: int) -> tuple[TrackedObject, ...]:
    """Things on a level plane, in rows; every fifth lies on the one before."""
    rng, objects = np.random.default_rng(3), []
    side = int(np.ceil(np.sqrt(count)))
    for k in range(count):
        row, column = divmod(k - (k % 5 == 4), side)
        size = rng.uniform(0.05, 0.15, 3)
        foot = float(objects[-1].box.size[2]) if k % 5 == 4 else 0.0
        center = np.array([column * SPACING_M, row * SPACING_M, foot + size[2] / 2])
        color = rng.uniform(0, 255, 3)
        objects.append(
            TrackedObject(
                FIRST + k, Box(center, size, np.eye(3)), 0.9, 0.9, 0, 9, 10, 100, color, 0, (), f"thing {k % 50}"
            )
        )
    return tuple(objects)


def made_plane(count: int) -> SupportPlane:
    reach = SPACING_M * (np.ceil(np.sqrt(count)) + 1)
    corners = np.array([[-1.0, -1.0, 0.0], [reach, -1.0, 0.0], [reach, reach, 0.0], [-1.0, reach, 0.0]])
    return SupportPlane(np.array([0.0, 0.0, 1.0]), 0.0, corners)


def write_results(folder: Path, objects: tuple[TrackedObject, ...]) -> None:
    """Write results with these objects and their relations; `cuboid mcp` answers about them."""
    with ResultWriter(folder, force=True) as writer:
        points = MapPoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))
        found = ObjectsFile(
            np.array([0.0, 0.0, 1.0]), Intrinsics(1, 1, 0, 0, 1, 1), (made_plane(len(objects)),), objects
        )
        timings = {"frame": Timing(1.0, 1.0)}
        report = RunReport("0", True, "made", "plain", "given", 1, {"every": 1}, 0, 0, (), timings, 1.0, 1.0)
        writer.finish(found.with_relations(points), points, report)


@dataclass
class Padded:
    """A tracker whose map has more objects."""

    tracker: Any
    more: tuple[TrackedObject, ...]

    @property
    def objects(self) -> list[TrackedObject]:
        """All objects, made anew, as a tracker's are."""
        return [*self.tracker.objects, *(replace(item) for item in self.more)]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.tracker, name)


def clients(http: str, mcp: str, count: int, labels: range, out: Any, stop: Any) -> None:
    """Ask in turn over HTTP and MCP until the run has ended; the process of the clients."""
    from threading import Thread

    found: dict[str, list[float]] = {}

    def ask_http(seed: int) -> None:
        rng = random.Random(seed)
        while not stop.is_set():
            what, question = rng.choice(list(QUESTIONS.items()))
            words = "&".join(f"{key}={value}".replace(" ", "%20") for key, value in question(rng, labels).items())
            with suppress(OSError):  # the run has begun only just, or has ended
                begun_s = time.perf_counter()
                urlopen(f"{http}api/objects?{words}", timeout=30).read()
                found.setdefault(f"HTTP: {what}", []).append(1e3 * (time.perf_counter() - begun_s))
            time.sleep(ASK_EVERY_S * rng.uniform(0.5, 1.5))

    async def ask_mcp(seed: int) -> None:
        rng = random.Random(seed)
        async with Client(mcp) as client:
            while not stop.is_set():
                name, values = rng.choice(
                    [
                        ("find_objects", {"name": f"thing {rng.randrange(50)}"}),
                        ("find_objects", {"on": str(rng.choice(labels))}),
                        ("describe_object", {"label": rng.choice(labels)}),
                    ]
                )
                begun_s = time.perf_counter()
                await client.call_tool(name, values)
                found.setdefault(f"MCP: {name}", []).append(1e3 * (time.perf_counter() - begun_s))
                await asyncio.sleep(ASK_EVERY_S * rng.uniform(0.5, 1.5))

    threads = [Thread(target=ask_http, args=(k,)) for k in range(count)]
    threads += [Thread(target=lambda k=k: asyncio.run(ask_mcp(k))) for k in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    out.put(found)


def tracked(case: Case, watch: Any) -> float:
    """Track the recording; return the median time of a frame, ms."""
    outcome = track_recording(open_recording(case.recording), None, hooks=RunHooks(watch=watch))
    return float(np.median(outcome.milliseconds["frame"][WARM_UP_FRAMES:]))


@contextmanager
def asked(http: str, mcp: str, count: int, labels: range, found: dict[str, list[float]]) -> Iterator[None]:
    """Run clients during the measurement, and collect the times of their answers, ms."""
    context = multiprocessing.get_context("spawn")
    out, stop = context.Queue(), context.Event()
    asking = context.Process(target=clients, args=(http, mcp, count, labels, out, stop), daemon=True)
    asking.start()
    time.sleep(STARTING_S)
    yield
    stop.set()
    for what, several in out.get(timeout=60).items():
        found.setdefault(what, []).extend(several)
    asking.join(60)


@contextmanager
def server(*words: str) -> Iterator[str]:
    """Run a server of ours, and give its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "cuboid", *words, "--port", "0"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split(" at ")[1].split(" (")[0]
    finally:
        process.kill()
        process.communicate()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="folder of recordings and results, kept between runs")
    parser.add_argument("--objects", type=int, default=10_000)
    parser.add_argument("--clients", type=int, default=2, help="over HTTP, and as many over MCP")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    (case,) = cases(["clutter"], [1], args.work, None, FRAMES)
    more, results = made_objects(args.objects), args.work / f"service-{args.objects}"
    if not results.is_dir():
        write_results(results, more)
    labels, times, other = range(FIRST, FIRST + len(more)), dict[str, list[float]](), dict[str, list[float]]()
    frames: dict[str, list[float]] = {"alone": [], "beside servers that are asked": [], "served and asked": []}
    with server("mcp", str(results), "--http") as mcp:
        tracked(case, None)
        for _ in range(args.rounds):
            alone, beside, served = frames.values()
            alone.append(tracked(case, None))
            with server("serve", str(results)) as http, asked(http, mcp, args.clients, labels, other):
                beside.append(tracked(case, None))
            address = listen(HOST, 0, None)
            with (
                ServedRun("made", address.listening, address.token, address.hosts) as run,
                asked(address.url, mcp, args.clients, labels, times),
            ):
                served.append(tracked(case, lambda frame, result, tracker: run(frame, result, Padded(tracker, more))))
    answers = {
        what: {
            "median_ms": float(np.median(several)),
            "p95_ms": float(np.quantile(several, 0.95)),
            "count": len(several),
        }
        for what, several in sorted(times.items())
    }
    if args.json:
        dump({"frames_ms": frames, "answers": answers})
        return
    least = {what: min(several) for what, several in frames.items()}
    rows = [(what, round(one, 2), round(one / least["alone"], 3), frames[what]) for what, one in least.items()]
    show("median frame, ms: the least of the rounds", ("run", "least", "ratio", "each"), rows)
    lines = [(what, round(one["median_ms"], 1), round(one["p95_ms"], 1), one["count"]) for what, one in answers.items()]
    show(
        f"answers about {args.objects} objects while a run goes on, ms", ("question", "median", "95 %", "asked"), lines
    )


if __name__ == "__main__":
    main()
