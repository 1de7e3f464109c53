"""Tracks recordings by the command line of any checkout, each in a process of its own, and keeps the results."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from cuboid.ground.formats.folder import AGENTS, EVENTS, MAP, OBJECTS, PROPOSALS, RUN, TRACKS, TRAJECTORY
from place_list import Part, Place, environment, last_line
from scenes import source_digest

# The files of a result that are judged; the others are deleted, except the map of made places (walls of relations).
JUDGED_FILES = {AGENTS, EVENTS, OBJECTS, PROPOSALS, RUN, TRACKS, TRAJECTORY}
# Packages that no stage of tracking imports: results do not depend on them.
NOT_TRACKING = ("lab", "services", "fleet")
# Number of short recordings that one process tracks: it loads its kernels once.
PARTS_A_PROCESS = 15
# `python -m cuboid track` once for each recording; the last line of its output lists the failures.
_CALLS = """
import contextlib, io, json, sys, traceback
from cuboid.cli import main
failures = {}
for recording, output in json.load(sys.stdin):
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            status = main(["track", recording, "--output", output, "--threads", "1", "--force"])
    except BaseException:
        status = traceback.print_exc(file=said) or 1
    if status:
        failures[output] = said.getvalue()
print("\\n" + json.dumps(failures))
"""


@dataclass(frozen=True, slots=True)
class Checkout:
    """A version of the program.

    Attributes
    ----------
    source : Path
        Folder that holds the package `cuboid`.
    results : Path
        Where its results are kept.
    """

    source: Path
    results: Path

    @classmethod
    def of(cls, source: Path, work: Path) -> Checkout:
        """Return the checkout whose sources are in a folder; results are kept by the digest of the source."""
        return cls(source, work / "tracked" / source_digest(source=source / "cuboid", without=NOT_TRACKING))

    def result(self, part: Part) -> Path:
        """Return the folder of the results of a recording."""
        return self.results / part.name


def track(checkout: Checkout, places: Sequence[Place], executor: Executor) -> Iterator[tuple[Place, str | None]]:
    """Track the recordings of places that have no results yet.

    Yields
    ------
    (Place, str or None)
        Each place once all of its recordings are tracked, and the reason if one of them failed.
    """
    waiting: dict[str, set[Future[dict[str, str]]]] = {}
    for place in places:
        missing = [part for part in place.parts if not (checkout.result(part) / RUN).is_file()]
        starts = range(0, len(missing), PARTS_A_PROCESS)
        groups = [missing[start : start + PARTS_A_PROCESS] for start in starts]
        waiting[place.name] = {executor.submit(_track_parts, checkout, group) for group in groups}
    left = {place.name: place for place in places}
    for _ in chain([None], as_completed({future for each in waiting.values() for future in each})):
        for place in [place for place in left.values() if all(one.done() for one in waiting[place.name])]:
            del left[place.name]
            reasons = [reason for future in waiting[place.name] for reason in future.result().values()]
            yield place, reasons[0] if reasons else None


def _track_parts(checkout: Checkout, parts: Sequence[Part]) -> dict[str, str]:
    """Track recordings in one process; return the reasons of failures by the part's name."""
    drafts = {part.name: checkout.results / f"{part.name}.part" for part in parts}
    for draft in drafts.values():
        shutil.rmtree(draft, ignore_errors=True)
    checkout.results.mkdir(parents=True, exist_ok=True)
    calls = [(str(part.recording), str(drafts[part.name])) for part in parts]
    done = subprocess.run(
        [sys.executable, "-c", _CALLS],
        input=json.dumps(calls),
        capture_output=True,
        text=True,
        check=False,
        env=environment(checkout.source),
    )
    if done.returncode:
        return {part.name: last_line(done.stderr) for part in parts}
    failures = json.loads(done.stdout.splitlines()[-1])
    for part in parts:
        if str(drafts[part.name]) not in failures:
            _keep(drafts[part.name], checkout.result(part), JUDGED_FILES | ({MAP} if part.synth else set()))
    return {part.name: last_line(failures[str(draft)]) for part, draft in zip(parts, drafts.values(), strict=True)
            if str(draft) in failures}  # fmt: skip


def _keep(draft: Path, result: Path, names: Collection[str]) -> None:
    """Move a result to its place, with these files of it."""
    for path in draft.iterdir():
        if path.name not in names:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    shutil.rmtree(result, ignore_errors=True)
    draft.rename(result)
