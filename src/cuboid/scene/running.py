"""A run of `cuboid track` whose recording goes into a scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from cuboid.core.config import TrackerConfig
from cuboid.core.frame import Float64Array, Intrinsics
from cuboid.core.paths import PathLike
from cuboid.core.results import SceneChange, Wall
from cuboid.outputs import ResultWriter
from cuboid.poses.sources import Poses
from cuboid.proposals.types import ProposalSource
from cuboid.scene.scene import Scene
from cuboid.scene.session import COMMIT_EVERY_S, SceneTracker
from cuboid.scene.visit import Source

# Where the frames that were skipped are kept until the run ends, beside the files of its results.
SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Begun:
    """The progress of a broken-off run at its last commit.

    Attributes
    ----------
    next_frame : int
        Of the recording: where to go on.
    skipped : tuple of (int, str)
        Frame and reason.
    T_world_camera : dict of int to (4, 4) float64
        Of each used frame.
    times_s : dict of int to float
    texts : dict of str to str
        What the files of the results held, by name.
    """

    next_frame: int = 0
    skipped: tuple[tuple[int, str], ...] = ()
    T_world_camera: Mapping[int, Float64Array] = field(default_factory=dict)
    times_s: Mapping[int, float] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class IntoScene:
    """The scene that a recording goes into.

    Attributes
    ----------
    path : path
        Of its file, which is made where there is none.
    same_world : bool
        The recording's given poses are in the scene's world; else they are aligned with it by the appearance of the
        place.
    resume : bool
        Go on with a run that was broken off.
    commit_every_s : float
        How often what is new is written.
    """

    path: PathLike
    same_world: bool = False
    resume: bool = False
    commit_every_s: float = COMMIT_EVERY_S

    def corrects(self, poses: str) -> bool:
        """Tell whether the poses of a recording, "given" or "estimated", are corrected while it is tracked."""
        if poses == "estimated" or self.same_world:
            return poses == "estimated"
        with Scene.open(self.path) as scene:
            return len(scene.recordings) > int(self.resume)

    def shown_changes(self) -> list[SceneChange]:
        """Return what the last recording changed, as the 3D page shows it."""
        with Scene.open(self.path) as scene:
            return scene.shown_changes(len(scene.recordings))

    @contextmanager
    def session(
        self,
        source: Source,
        camera: Intrinsics,
        config: TrackerConfig,
        proposals: str | ProposalSource | None,
        memory_mb: float,
    ) -> Iterator[SceneRun]:
        """Open the scene for a run; without `SceneRun.finish` the scene ends as committed last.

        Raises
        ------
        InputError
            The scene cannot be used, or the recording cannot be placed in it.
        OutputError
            Another one writes the scene, or it cannot be written.
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
    begun : Begun
        What was done before the run was broken off; nothing in a new one.
    """

    def __init__(self, scene: Scene, tracker: SceneTracker) -> None:
        self.tracker = tracker
        tracker.commits_itself = False
        texts = scene.pending()
        skipped = [line.split("\t", 1) for line in texts.pop(SKIPPED, "").splitlines()]
        poses = scene.poses(tracker.visit.number)
        self.begun = Begun(
            tracker.visit.next_frame,
            tuple((int(frame), reason) for frame, reason in skipped),
            {frame: T for frame, (_, T) in poses.items()},
            {frame: time_s for frame, (time_s, _) in poses.items()},
            texts,
        )

    def go_on(self, frames: range, writer: ResultWriter | None) -> range:
        """Let results go on where the run was broken off, and return which frames are left."""
        if writer is not None:
            writer.go_on(self.begun.texts, self.tracker.keep)
        passed = max(0, -(-(self.begun.next_frame - frames.start) // frames.step))
        return frames[min(passed, len(frames)) :]

    def poses(self, given: Poses) -> Poses:
        """Return where poses in the scene's world come from."""
        return self.tracker.poses(given)

    def warnings(self) -> tuple[str, ...]:
        """Return what the user should know of the recording in the scene."""
        return self.tracker.warnings()

    def next_frame(self) -> None:
        """Commit what is new, where it is time."""
        self.tracker.commit_if_due()

    def skip(self, index: int, reason: str) -> None:
        """Tell that a frame was skipped."""
        self.tracker.keep(SKIPPED, f"{index}\t{reason}\n")
        self.tracker.skip(index)

    def finish(self, *, complete: bool, walls: Sequence[Wall] | None = None) -> None:
        """Commit all; with `complete`, the results are whole and nothing is left to go on with.

        With the walls of the place, the relations of the objects are noted too.
        """
        self.tracker.close(complete=complete, walls=walls)
