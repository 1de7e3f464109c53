"""A scene: one file per place that can be opened, queried and extended."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.method.poses.sources import ESTIMATED
from cuboid.method.proposals import make_source
from cuboid.method.proposals.types import ProposalSource
from cuboid.results.files.naming import checked_name
from cuboid.runs.scene import before, editing
from cuboid.runs.scene import visit as visits
from cuboid.runs.scene.database import Writing, open_to_read, transaction, user_errors
from cuboid.runs.scene.furniture import read_names, write_name
from cuboid.runs.scene.localisation import OWN_WORLD, SAME_WORLD, ScenePoses
from cuboid.runs.scene.reader import SceneReader
from cuboid.runs.scene.saving import SceneBlockStore, has_state, load_state
from cuboid.runs.scene.session import COMMIT_EVERY_S, OwnFrames, SceneTracker
from cuboid.runs.scene.validation import columns_of, read_rows
from cuboid.runs.scene.visit import RecordingInfo
from cuboid.runs.tracking.posed_tracker import PosedTracker

if TYPE_CHECKING:
    from cuboid.method.text_search import Embeddings, TextModel
    from cuboid.runs.scene.vectors import SceneVector


class Scene(SceneReader):
    """A scene in its file: map, objects and labels, which each recording extends.

    Use it as a context manager. Reading takes no lock and sees the commits of other processes. The first call that
    writes takes the exclusive write lock, and holds it until the scene is closed.

    Parameters
    ----------
    path : path
        The scene file; the first call that writes creates it.
    """

    def __init__(self, path: PathLike) -> None:
        super().__init__(path)
        self._write: Writing | None = None
        self._block_connection: sqlite3.Connection | None = None
        self._tracker: SceneTracker | None = None

    @classmethod
    def open(cls, path: PathLike) -> Scene:
        """Open a scene that exists or will be created.

        Raises
        ------
        InputError
            The file is no scene, damaged, or of a newer version.
        """
        return cls(path)

    def __enter__(self) -> Scene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._tracker is not None and kind is None:
                self._tracker.close()
            elif self._tracker is not None:
                with suppress(Exception):  # the first error is the one that is reported
                    self._tracker.close(complete=False)
        finally:
            self.close()

    def close(self) -> None:
        """Close the file; uncommitted changes are dropped."""
        if self._tracker is not None:
            self._tracker.drop()
            self._tracker = None
        if self._block_connection is not None:
            self._block_connection.close()
            self._block_connection = None
        if self._read is not None:
            self._read.close()
            self._read = self._saved = None
        if self._write is not None:
            self._write.close()
            self._write = None

    def tracker(
        self,
        intrinsics: Intrinsics,
        config: TrackerConfig | None = None,
        proposals: str | ProposalSource | None = None,
        *,
        source: RecordingInfo | None = None,
        same_world: bool = True,
        resume: bool = False,
        commit_every_s: float = COMMIT_EVERY_S,
        memory_mb: float = MEMORY_MB,
    ) -> SceneTracker:
        """Begin a recording whose frames have poses in the scene's world, or resume an interrupted one.

        Parameters
        ----------
        intrinsics : Intrinsics
            Intrinsics of every frame.
        config : TrackerConfig, optional
            Configuration of a new scene; an existing scene keeps its own.
        proposals : str or ProposalSource, optional
            As for `Tracker`.
        source : RecordingInfo, optional
            Description of the recording that the scene stores.
        same_world : bool
            Whether given poses are in the scene's world; else `SceneTracker.poses` aligns them with it.
        resume : bool
            Whether to continue the last recording, from the frame `visit.next_frame` on.
        commit_every_s : float
        memory_mb : float
            As for `Tracker`.

        Raises
        ------
        InputError
            The scene's state is damaged; there is nothing to resume; the last run of the same recording was interrupted
            and is not resumed; `config` differs from the scene's configuration; or poses must be aligned with a scene
            that has no keyframes.
        OutputError
            Another process writes the scene, or it cannot be written.
        """
        source = source or RecordingInfo("", "frames", "given", 0, intrinsics, {})
        if self._tracker is not None:
            self._tracker.close()
        file = self._writing()
        connection = file.connection
        with user_errors(self.path):
            renumbered = OwnFrames(make_source(proposals))
            if self._block_connection is not None:
                self._block_connection.close()
            self._block_connection = open_to_read(self.path)
            block_store = SceneBlockStore(self._block_connection, self.path)
            if has_state(connection):
                tracker, poses = load_state(
                    connection, intrinsics, renumbered, memory_mb=memory_mb, block_store=block_store
                )
                self._refuse_other_config(tracker.config, config)
            else:  # a damaged file may have lost its state
                tracker = PosedTracker(intrinsics, config, renumbered, memory_mb=memory_mb)
                poses = ScenePoses(intrinsics, tracker.config)
                tracker.begin_labels(
                    1 + connection.execute("SELECT coalesce(max(label), 0) FROM objects").fetchone()[0]
                )
            mode = ESTIMATED if source.poses == ESTIMATED else SAME_WORLD if same_world else OWN_WORLD
            if resume:
                visit = visits.resume(connection, source, str(self.path))
            else:
                if mode == OWN_WORLD and self.recordings and not poses.knows_places:
                    raise InputError(
                        f"{self.path}: has no keyframes to recognise the place by; --same-world says that the "
                        "recording's poses are in the scene's world"
                    )
                visit = visits.begin(connection, source, tracker, str(self.path))
            earlier = before.load(connection)
            earlier.watch(tracker.voxels)
            if visit.next_frame == 0:
                poses.begin(mode, first=visit.number == 1)
                if visit.number > 1:
                    tracker.begin_visit()
            renumbered.first_frame = visit.first_frame
            columns = columns_of("objects", ("label", "name"))
            names: dict[int, str] = dict(read_rows(connection, columns, "objects WHERE name IS NOT NULL"))
            names |= read_names(connection)
        self._tracker = SceneTracker(
            self.path, file, tracker, poses, visit, names, commit_every_s, block_store, earlier
        )
        return self._tracker

    def _refuse_other_config(self, present: TrackerConfig, requested: TrackerConfig | None) -> None:
        """Raise InputError if a requested setting is neither the default nor the scene's own."""
        for name, value in (requested or present).to_dict().items():
            if value not in (getattr(TrackerConfig(), name), getattr(present, name)):
                raise InputError(
                    f"{self.path}: the scene was made with {name} = {getattr(present, name):g}, not {value:g}"
                )

    def pending(self) -> dict[str, str]:
        """Return the result files' contents, by name, at the interruption of the resumed run."""
        assert self._tracker is not None
        assert self._write is not None
        with user_errors(self.path):
            return visits.pending(self._write.connection, self._tracker.visit)

    def name(self, label: int, name: str) -> None:
        """Set the name of an object or of a piece of furniture; an empty name removes it.

        Raises
        ------
        InputError
            Neither has the label, or the name is not a single line of at most 100 characters.
        """
        name = checked_name(self.path, name)
        connection = self._writing().connection
        with user_errors(self.path), transaction(connection):
            named = connection.execute("UPDATE objects SET name = ? WHERE label = ?", (name or None, label)).rowcount
        if named:
            return
        if label not in self.furniture_planes:
            raise InputError(f"{self.path}: no object has the label {label}")
        with user_errors(self.path), transaction(connection):
            write_name(connection, label, name)

    def merge(self, first: int, second: int) -> int:
        """Merge two objects that are the same; return the older label, which stays.

        Raises
        ------
        InputError
            One of the objects does not exist, or both are the same.
        """
        connection = self._writing().connection
        with user_errors(self.path):
            return editing.merge(connection, str(self.path), first, second)

    def forget(self, label: int) -> None:
        """Delete an object: its label is never reused, and its surface may become another object.

        Raises
        ------
        InputError
            No object ever had the label.
        """
        self._labels_of(label)
        connection = self._writing().connection
        with user_errors(self.path):
            editing.forget(connection, str(self.path), label)

    def write_results(self, folder: PathLike, recording: int | None = None, *, force: bool = False) -> None:
        """Write a result folder of a recording (default: the last one), as `cuboid track` does.

        Raises
        ------
        InputError
            There is no such recording, or the scene has no state.
        OutputError
            The results cannot be written.
        """
        from cuboid.runs.scene.results_of import write_results

        with user_errors(self.path):
            number = len(self.recordings) if recording is None else recording
            connection = self._connection()
            connection.execute("BEGIN")  # all reads see the same commit
            try:
                write_results(self, connection, number, as_path(folder), force=force)
            finally:
                connection.execute("COMMIT")

    def keep_vectors(self, found: Embeddings) -> None:
        """Store objects' vectors by an image-text model, as returned by `Results.embed`, for `find`.

        Raises
        ------
        OutputError
            Another process writes the scene, or it cannot be written.
        """
        from cuboid.runs.scene.vectors import SceneVector, write_vectors

        connection = self._writing().connection
        with user_errors(self.path), transaction(connection):
            vectors = {label: SceneVector(vector, None) for label, vector in found.vectors.items()}
            write_vectors(connection, found.model, vectors)

    def _keep_made(self, model: TextModel, computed: Mapping[int, SceneVector]) -> None:
        from cuboid.runs.scene.vectors import write_vectors

        # Another process may hold the write lock while it adds a recording: the vectors are then computed again next
        # time.
        with suppress(OutputError), user_errors(self.path):
            connection = self._writing().connection
            with transaction(connection):
                write_vectors(connection, model.identity, computed)

    def compact(self) -> None:
        """Rewrite the file without its free space."""
        connection = self._writing().connection
        with user_errors(self.path):
            with transaction(connection):
                connection.execute("DELETE FROM boxes WHERE id NOT IN (SELECT box FROM sightings)")
            connection.execute("VACUUM")

    def _writing(self) -> Writing:
        if self._tracker is not None:
            self._tracker.finish_commit()
        if self._write is None:
            self._write = Writing(self.path, create=True)
        return self._write
