"""A run of `cuboid track` that adds its recording to a scene."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.paths import PathLike
from cuboid.ground.core.results import SceneChange
from cuboid.method.proposals.types import ProposalSource
from cuboid.results.files import ResultWriter
from cuboid.runs.scene.scene import Scene
from cuboid.runs.scene.session import COMMIT_EVERY_S, SceneTracker
from cuboid.runs.scene.visit import RecordingInfo
from cuboid.runs.tracking.running import RunningTracker

# Name under which the scene keeps the skipped frames until the run ends, beside the result files.
SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class IntoScene:
    """The scene to which a recording is added, and how.

    Attributes
    ----------
    path : path
        The scene file; it is created if it is missing.
    same_world : bool
        Whether the recording's given poses are in the scene's world; else they are aligned with it by the appearance of
        the place.
    resume : bool
        Whether to continue an interrupted run.
    commit_every_s : float
        Interval of commits, seconds.
    """

    path: PathLike
    same_world: bool = False
    resume: bool = False
    commit_every_s: float = COMMIT_EVERY_S

    def corrects(self, poses: str) -> bool:
        """Return whether a recording's poses ("given" or "estimated") are corrected while it is tracked."""
        if poses == "estimated" or self.same_world:
            return poses == "estimated"
        with Scene.open(self.path) as scene:
            return len(scene.recordings) > int(self.resume)

    def shown_changes(self) -> list[SceneChange]:
        """Return the changes of the last recording, as the 3D page shows them."""
        with Scene.open(self.path) as scene:
            return scene.shown_changes(len(scene.recordings))

    @contextmanager
    def session(
        self,
        source: RecordingInfo,
        camera: Intrinsics,
        config: TrackerConfig,
        proposals: str | ProposalSource | None,
        memory_mb: float,
    ) -> Iterator[SceneRun]:
        """Open the scene for a run; without `SceneTracker.close` the scene stays as last committed.

        Raises
        ------
        InputError
            The scene cannot be used, or the recording cannot be placed in it.
        OutputError
            Another process writes the scene, or it cannot be written.
        """
        with Scene.open(self.path) as scene:
            tracker = scene.tracker(
                camera,
                config,
                proposals,
                source=source,
                same_world=self.same_world,
                resume=self.resume,
                commit_every_s=self.commit_every_s,
                memory_mb=memory_mb,
            )
            try:
                yield SceneRun(scene, tracker)
            finally:
                tracker.drop()


class SceneRun:
    """A run in a scene.

    Attributes
    ----------
    tracker : SceneTracker
    """

    def __init__(self, scene: Scene, tracker: SceneTracker) -> None:
        self.tracker = tracker
        tracker.commits_itself = False
        self._texts = scene.pending()
        self._skipped = [line.split("\t", 1) for line in self._texts.pop(SKIPPED, "").splitlines()]
        self._poses = scene.poses(tracker.visit.number)

    def go_on(self, frames: Sequence[int], writer: ResultWriter | None) -> Sequence[int]:
        """Continue the results of an interrupted run, and return the remaining frames."""
        if writer is not None:
            writer.go_on(self._texts, self.tracker.keep)
        return frames[bisect_left(frames, self.tracker.visit.next_frame) :]

    def resume(self, tracker: RunningTracker) -> None:
        """Give a tracker the poses, times and skipped frames of a run before its interruption."""
        tracker.resume(
            {frame: T for frame, (_, T) in self._poses.items()},
            {frame: time_s for frame, (time_s, _) in self._poses.items()},
            tuple((int(frame), reason) for frame, reason in self._skipped),
        )

    def skip(self, index: int, reason: str) -> None:
        """Record that a frame was skipped."""
        self.tracker.keep(SKIPPED, f"{index}\t{reason}\n")
        self.tracker.skip(index)
