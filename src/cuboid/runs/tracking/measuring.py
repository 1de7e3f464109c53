"""Frame counts and stage times of a run."""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.compiling.compiletime import working_s
from cuboid.ground.core.limits import LIMITS
from cuboid.results.files import LimitReached, Timing

# The first used frames include the loading of kernels and the filling of caches: stage times exclude them, unless the
# run is so short that few frames would remain.
WARM_UP_FRAMES = 10
# Largest ratio of the mean time of a frame with a detector to the time without.
DETECTOR_BUDGET = 1.5


def warm_up_of(used: int) -> int:
    """Return the number of used frames of a run that count as warm-up."""
    return WARM_UP_FRAMES if used >= 2 * WARM_UP_FRAMES else 0


class FrameLog:
    """Counts frames, and stores the reasons of skipped ones and the times of used ones.

    Attributes
    ----------
    used : int
    skipped : list of (int, str)
        Frame index and reason.
    milliseconds : dict of str to array
        Times of every used frame, for "frame" and for each stage.
    """

    def __init__(self) -> None:
        self.used = 0
        self.skipped: list[tuple[int, str]] = []
        self.milliseconds: dict[str, array[float]] = {"frame": array("d")}
        self._finished_s = array("d")
        self._left_out: dict[str, list[int]] = {limit: [] for limit in LIMITS}

    @property
    def read(self) -> int:
        """Number of frames read, used or not."""
        return self.used + len(self.skipped)

    def skip(self, index: int, reason: str) -> None:
        """Count a skipped frame."""
        self.skipped.append((index, reason))

    def use(self, milliseconds: Mapping[str, float], left_out: Mapping[str, int] | None = None) -> None:
        """Count a used frame with its times, and with the numbers of items beyond its limits."""
        for limit, count in (left_out or {}).items():
            if count:
                self._left_out[limit].append(count)
        self.used += 1
        self._finished_s.append(working_s())
        for stage, time_ms in milliseconds.items():
            # a stage without work in a frame gets the time 0
            values = self.milliseconds.setdefault(stage, array("d", [0.0] * (self.used - 1)))
            values.append(time_ms)
        for values in self.milliseconds.values():
            values.extend([0.0] * (self.used - len(values)))

    def limits(self) -> dict[str, LimitReached]:
        """Return the limits that frames have reached."""
        return {
            limit: LimitReached(LIMITS[limit], len(counts), sum(counts))
            for limit, counts in self._left_out.items()
            if counts
        }

    @property
    def _warm(self) -> int:
        return warm_up_of(self.used)

    def frames_per_second(self) -> float:
        """Return the used frames per second after warm-up; 0 for fewer than two frames."""
        finished_s = self._finished_s[self._warm :]
        return (len(finished_s) - 1) / (finished_s[-1] - finished_s[0]) if len(finished_s) > 1 else 0.0

    def timings(self) -> dict[str, Timing]:
        """Return median and 95th percentile of each stage after warm-up."""
        start = self._warm
        return {stage: Timing.of(values[start:]) for stage, values in self.milliseconds.items() if len(values)}


@dataclass(frozen=True, slots=True)
class DetectorCost:
    """The time that a detector adds to the frames of a run.

    Attributes
    ----------
    detector_ms : float
        Median time of the detector in a frame that it processes.
    median_ratio, mean_ratio : float
        Median and mean time of a frame with the detector, over those without.
    every : int
        Smallest n for which a detector on each n-th frame keeps the mean ratio within `DETECTOR_BUDGET`.
    """

    detector_ms: float
    median_ratio: float
    mean_ratio: float
    every: int

    @classmethod
    def of(cls, frame_ms: npt.ArrayLike, detector_ms: npt.ArrayLike) -> DetectorCost | None:
        """Return the cost of a run; None if the detector processed no frame after warm-up.

        Parameters
        ----------
        frame_ms, detector_ms : (N,) array_like
            Time of each used frame, and of the detector in it: 0 if it did not process the frame.
        """
        total_ms, part_ms = (np.asarray(values, np.float64) for values in (frame_ms, detector_ms))
        if not len(part_ms):
            return None
        start = warm_up_of(len(total_ms))
        total_ms, part_ms = total_ms[start:], part_ms[start:]
        rest_ms, detecting_ms = total_ms - part_ms, part_ms[part_ms > 0.0]
        if not len(detecting_ms) or rest_ms.mean() <= 0.0:
            return None
        return cls(
            detector_ms=float(np.median(detecting_ms)),
            median_ratio=float(np.median(total_ms) / np.median(rest_ms)),
            mean_ratio=float(total_ms.mean() / rest_ms.mean()),
            every=max(1, math.ceil(detecting_ms.mean() / ((DETECTOR_BUDGET - 1.0) * rest_ms.mean()))),
        )


class FrameClock:
    """Measures the stages of one frame in milliseconds, in processing order, without the time to compile kernels.

    Parameters
    ----------
    before : dict of str to float, optional
        Times of stages before the start of this clock.

    Attributes
    ----------
    milliseconds : dict of str to float
    """

    def __init__(self, before: dict[str, float] | None = None) -> None:
        self.milliseconds = before = {} if before is None else before
        self._before_ms = sum(before.values())
        self._begun_s = self._last_s = working_s()

    def lap(self, stage: str) -> None:
        """Assign the time since the last lap to a stage."""
        now_s = working_s()
        self._add(stage, (now_s - self._last_s) * 1e3)
        self._last_s = now_s

    def _add(self, stage: str, time_ms: float) -> None:
        self.milliseconds[stage] = self.milliseconds.get(stage, 0.0) + time_ms

    def laps(self, milliseconds: Mapping[str, float]) -> None:
        """Add times that were measured elsewhere, and start the next lap."""
        for stage, time_ms in milliseconds.items():
            self._add(stage, time_ms)
        self._last_s = working_s()

    def done(self) -> dict[str, float]:
        """Return the total time, "frame", and the times of the stages."""
        return {"frame": self._before_ms + (working_s() - self._begun_s) * 1e3, **self.milliseconds}


def peak_memory_mb() -> float:
    """Return the peak memory of this process, in units of 2**20 bytes."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage includes the memory of the parent before this process was started
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024.0
    return _peak_mb()


if sys.platform == "win32":

    def _peak_mb() -> float:
        """Return the peak from Windows' PROCESS_MEMORY_COUNTERS: two 32-bit numbers, then sizes, the peak first."""
        import ctypes

        counters = (ctypes.c_size_t * 9)()
        kernel32 = ctypes.WinDLL("kernel32")
        kernel32.GetCurrentProcess.restype = ctypes.c_void_p
        kernel32.K32GetProcessMemoryInfo.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32]
        kernel32.K32GetProcessMemoryInfo(kernel32.GetCurrentProcess(), counters, ctypes.sizeof(counters))
        return counters[1] / 2**20

else:

    def _peak_mb() -> float:
        import resource

        unit = 2**20 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
