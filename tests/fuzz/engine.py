"""Runs inputs one by one in this process, each with a limit of time and memory, and says which of them fail."""

from __future__ import annotations

import faulthandler
import hashlib
import os
import random
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from changes import Change, changed, keep
from mutations import mutated

from cuboid.ground.core.errors import LONGEST_MESSAGE, CuboidError

LIMIT_S = 5.0
# What hangs outside of Python does not hear the alarm: then the process ends, with a traceback of where it was.
DEAD_S = 60.0
# Of the call alone: other tests may have left the process with more.
LIMIT_BYTES = 3 << 28
# The numbers of a kept case that tell it from others.
DIGITS = 12


class TookTooLong(BaseException):
    """An input took more than its time."""


@dataclass(frozen=True)
class Target:
    """Something that is given bad files.

    Attributes
    ----------
    make : callable
        Writes good files into a folder.
    paths : callable
        Folder -> the files in it that are changed, as seen from the folder.
    calls : mapping of str to callable
        Folder -> anything; raises CuboidError where the files cannot be used.
    mutate : callable
        (random numbers, path, content) -> what lies in the place of a file.
    """

    make: Callable[[Path], None]
    paths: Callable[[Path], list[str]]
    calls: dict[str, Callable[[Path], object]]
    mutate: Callable[[random.Random, str, bytes], Change] = mutated


@dataclass
class Outcome:
    """What came of a run.

    Attributes
    ----------
    inputs, calls : int
    refused : int
        Calls that ended with an error of one line.
    faults : dict of str to (str, list of Change)
        By what is wrong, and where: call and first input.
    """

    inputs: int = 0
    calls: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    faults: dict[str, tuple[str, list[Change]]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)

    def add(self, fault: str, call: str, changes: Sequence[Change]) -> None:
        self.counts[fault] += 1
        self.faults.setdefault(fault, (call, list(changes)))


def fault_of(call: Callable[[Path], object], folder: Path) -> tuple[str, bool]:
    """Return what is wrong with how a call took its input, nothing where all is well; and whether it refused it."""
    before = peak_bytes(), psutil.Process().memory_info().rss
    try:
        with alarm(LIMIT_S), warnings.catch_warnings():
            warnings.simplefilter("error")
            call(folder)
    except TookTooLong:
        return f"took more than {LIMIT_S:g} s: {_position()}", False
    except CuboidError as error:
        line = str(error)
        if len(line) > LONGEST_MESSAGE or not line.isprintable():
            return f"no short line: {type(error).__name__}", True
        return _memory(*before), True
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)
        own = [entry for entry in at if "/cuboid/" in entry.filename] or at
        return f"{type(error).__name__} at {own[-1].filename.rpartition('/cuboid/')[2]}:{own[-1].lineno}", False
    return _memory(*before), False


def _memory(peak: int, resident: int) -> str:
    """Tell what a call took beside what was held before it, bytes; a peak no higher than an older one tells nothing."""
    now = peak_bytes()
    took = now - resident if now > peak else 0
    return f"took {took >> 20} MB" if took > LIMIT_BYTES else ""


def peak_bytes() -> int:
    """Return the most memory that this process has ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def _position() -> str:
    at = traceback.extract_tb(sys.exc_info()[2])
    own = [entry for entry in at if "/src/cuboid/" in entry.filename] or at
    return f"{own[-1].filename.rpartition('/cuboid/')[2]}:{own[-1].lineno}"


@contextmanager
def alarm(limit_s: float) -> Iterator[None]:
    """Raise TookTooLong after a while."""

    def ring(number: int, frame: object) -> None:
        raise TookTooLong

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    faulthandler.dump_traceback_later(DEAD_S, exit=True, file=sys.__stderr__)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, before)


def fuzz(target: Target, folder: Path, inputs: int, seed: int, calls_each: int | None = None) -> Outcome:
    """Give a target so many bad inputs.

    Parameters
    ----------
    target : Target
    folder : Path
        An empty one.
    inputs, seed : int
    calls_each : int, optional
        How many of the target's calls, drawn at random, get each input; all unless given.
    """
    target.make(folder)
    paths, outcome = target.paths(folder), Outcome()
    for call in target.calls.values():
        with as_before(target, folder):
            call(folder)  # what is loaded or compiled once is no input's fault
    for number in range(inputs):
        rng = random.Random(f"{seed}:{number}")
        chosen = rng.sample(paths, rng.choice((1, 1, 1, 2)) if len(paths) > 1 else 1)
        changes = [target.mutate(rng, path, (folder / path).read_bytes()) for path in sorted(chosen)]
        names = sorted(target.calls)
        some = names if calls_each is None else rng.sample(names, min(calls_each, len(names)))
        outcome.inputs += 1
        try_changes(target, folder, changes, some, outcome)
    return outcome


def as_before(target: Target, folder: Path) -> AbstractContextManager[None]:
    """Let a target's files be as before afterwards, and no others be there."""
    return changed(folder, [Change(path, (folder / path).read_bytes()) for path in sorted(set(target.paths(folder)))])


def try_changes(
    target: Target, folder: Path, changes: Sequence[Change], calls: Sequence[str], outcome: Outcome
) -> None:
    """Make changes to a target's files, call it, and note what came of it."""
    with changed(folder, changes):
        for name in calls:
            begun_s = time.perf_counter()
            fault, refused = fault_of(target.calls[name], folder)
            outcome.slowest_s = max(outcome.slowest_s, time.perf_counter() - begun_s)
            outcome.calls += 1
            outcome.refused += refused
            if fault:
                outcome.add(fault, name, changes)


def keep_faults(outcome: Outcome, target: str, folder: Path) -> list[Path]:
    """Write the first input of each fault as a case for the tests."""
    written = []
    for fault, (call, changes) in outcome.faults.items():
        digest = hashlib.sha256(f"{target} {fault}".encode()).hexdigest()[:DIGITS]
        path = folder / f"{target}-{digest}.json"
        keep(path, target, changes, f"{call}: {fault}")
        written.append(path)
    return written


def quiet_libraries() -> None:
    """Let OpenCV say nothing of images that it cannot read."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    import cv2

    cv2.setNumThreads(1)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
