"""The tracker of a node: it processes frames; between two frames, a command can save, reset or query it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from cuboid.ground.core.errors import FrameError, InputError, OutputError
from cuboid.ground.core.frame import Frame, SkippedFrame
from cuboid.ground.core.results import FrameResult, TrackedObject
from cuboid.results.files import Results
from cuboid.results.files.naming import checked_name, name_object
from cuboid.results.files.queries import PointCloud
from cuboid.runs.tracking.saving import write_page
from cuboid.runs.tracking.tracker import Tracker


class Session:
    """A tracker that can start again.

    Parameters
    ----------
    make_tracker : callable
        Makes the tracker; `reset` calls it again.
    output : Path or None
        Folder of the results; None: the node cannot save results.
    force : bool
        Whether existing results may be replaced.

    Raises
    ------
    OutputError
        Results exist and may not be replaced.

    Attributes
    ----------
    tracker : Tracker
    names : dict of int to str
        Names that users gave, by label.
    used, skipped : int
        Numbers of used and skipped frames since the start of the node.
    """

    def __init__(self, make_tracker: Callable[[], Tracker], output: Path | None, *, force: bool = False) -> None:
        self._make = make_tracker
        self._output, self._force = output, force
        if output is not None and output.exists() and not force:
            raise OutputError(f"{output}: exists; --force replaces results in it")
        self._first: int | None = None
        self.tracker = make_tracker()
        self.names: dict[int, str] = {}
        self.used = self.skipped = 0

    def take(self, frame: Frame) -> FrameResult | SkippedFrame:
        """Process a frame; its number counts from the last `reset`."""
        if self._first is None:
            self._first = frame.index
        result = self.tracker.update(dataclasses.replace(frame, index=frame.index - self._first))
        if isinstance(result, FrameResult):
            self.used += 1
        else:
            self.skipped += 1
        return result

    def reset(self) -> None:
        """Delete the map and the names, and start again with the next frame."""
        self.tracker, self._first = self._make(), None
        self.names.clear()

    def save(self, folder: str = "") -> Path:
        """Write the results of the frames so far; return their folder.

        Parameters
        ----------
        folder : str
            Name of a folder beside `output`; if empty, `output`.

        Raises
        ------
        InputError
            There is nothing to save, the node has no output folder, or the name is not valid.
        OutputError
            The folder exists, or it cannot be written.
        """
        if self._output is None:
            raise InputError("the node was started without --output: it has no folder to save in")
        if self.tracker.poses is None:
            raise InputError("no frame has come yet: there is nothing to save")
        if folder in (".", "..") or Path(folder).name != folder:
            raise InputError(f"expected the name of a folder beside {self._output}, without a path, got '{folder}'")
        output = self._output.parent / folder if folder else self._output
        self.tracker.save(output, force=self._force and not folder)
        results = Results(output)
        named = [item.label for item in (*results.objects, *results.gone) if item.label in self.names]
        for label in named:
            name_object(output, label, self.names[label])
        if named:
            write_page(Results(output), _no_picture)
        if not folder:
            self._force = True  # this run may replace its own results
        return output

    def name(self, label: int, name: str) -> TrackedObject:
        """Set the name of an object; an empty name removes it.

        Raises
        ------
        InputError
            No object has the label, or the name is not valid.
        """
        item = self.tracker.objects.find(label)
        name = checked_name("name", name)
        if name:
            self.names[item.label] = name
        else:
            self.names.pop(item.label, None)
        return item

    def query(
        self, label: int = 0, name: str = "", near: tuple[float, float, float] = (0.0, 0.0, 0.0), within_m: float = 0.0
    ) -> list[TrackedObject]:
        """Return the objects that meet all conditions, by label; with a distance, the nearest first.

        Parameters
        ----------
        label : int
            0: all objects.
        name : str
            Part of the name, in lower or upper case; empty: all objects.
        near : (3,) float
            A point in the world, metres.
        within_m : float
            Largest distance from `near`, metres; 0: no limit.

        Raises
        ------
        InputError
            No object has the label, or a number is not finite.
        """
        objects = list(self.tracker.near(near, within_m) if within_m else self.tracker.objects)
        if label:
            wanted = self.tracker.objects.find(label).label
            objects = [item for item in objects if item.label == wanted]
        part = name.casefold()
        return [item for item in objects if part in (self.names.get(item.label) or item.name or "").casefold()]

    def cloud(self, label: int = 0) -> PointCloud:
        """Return the points of an object, or of the whole map for label 0; raise InputError for an unknown label."""
        if label:
            return self.tracker.cloud(label)
        points = self.tracker.map_points()
        return PointCloud(points.xyz, points.rgb)

    def finish(self) -> Path | None:
        """Write the results at the end, if there is a folder for them and a frame was used."""
        if self._output is None or not self.tracker.T_world_camera:
            return None
        return self.save()


def _no_picture(index: int) -> Frame:
    raise FrameError("a node keeps no images")
