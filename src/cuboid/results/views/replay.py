"""Replay of a finished run from its result folder: the seen and the hidden objects of each frame."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass, replace

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.paths import PathLike
from cuboid.ground.core.results import names_of
from cuboid.ground.geometry.box import Box
from cuboid.inputs.readers.recording import Recording
from cuboid.results.files import ProposalRow, Results, TrackRow
from cuboid.results.files.text import LENGTH, number


@dataclass(frozen=True, slots=True)
class ReplayedObject:
    """An object that is known in a frame.

    Attributes
    ----------
    label : int
    box : Box
        In the world, as it was last seen up to that frame.
    """

    label: int
    box: Box


@dataclass(frozen=True, slots=True)
class ReplayedFrame:
    """The results of one frame.

    Attributes
    ----------
    index : int
        Of the recording.
    T_world_camera : (4, 4) float64
    sightings : tuple of TrackRow
    proposals : tuple of ProposalRow
    hidden : tuple of ReplayedObject
        Known objects that the frame does not see.
    """

    index: int
    T_world_camera: Float64Array
    sightings: tuple[TrackRow, ...]
    proposals: tuple[ProposalRow, ...]
    hidden: tuple[ReplayedObject, ...]

    @property
    def objects_known(self) -> int:
        """Objects known in this frame, seen or not."""
        return len(self.sightings) + len(self.hidden)

    def only(self, labels: Container[int]) -> ReplayedFrame:
        """Return the frame with the objects that have one of these labels."""
        sightings = tuple(one for one in self.sightings if one.label in labels)
        return replace(self, sightings=sightings, hidden=tuple(one for one in self.hidden if one.label in labels))


class Replay:
    """The results of a run, frame by frame.

    Parameters
    ----------
    folder : path
        A result folder of `cuboid track`.
    recording_path : Path, optional
        Present path of the recording (default: its path during the run).

    Attributes
    ----------
    intrinsics : Intrinsics
        Of the recording's color image.
    every : int
        Every n-th frame was used.
    planes : sequence of SupportPlane
        Planes of the whole run.
    last_frame : int
        The last used frame of the recording; -1 if no frame was used.
    names : dict of int to str
        Names of the objects, by label.

    Raises
    ------
    InputError
        The folder is not a result folder, or a file in it is malformed.
    """

    def __init__(self, folder: PathLike, recording_path: PathLike | None = None) -> None:
        results = Results(folder, recording_path)
        report = results.report
        self._results = results
        self.intrinsics: Intrinsics = results.found.intrinsics
        self.every = report.every
        self.planes = results.found.planes
        self.last_frame = results.last_frame
        self.names = names_of(results.found.objects)
        self._lasting = {item.label for item in results.found.objects}
        self._poses = results.poses
        self._sightings: dict[int, list[TrackRow]] = defaultdict(list)
        self._proposals: dict[int, list[ProposalRow]] = defaultdict(list)
        for row in results.tracks:
            self._sightings[row.frame].append(row)
        for proposal in results.proposals:
            self._proposals[proposal.frame].append(proposal)

    def __len__(self) -> int:
        """Return the number of used frames."""
        return len(self._poses)

    @property
    def recording(self) -> Recording:
        """The recording of the results; raises InputError if it does not exist."""
        return self._results.recording

    def frames(self, timestamp_of: Callable[[int], float]) -> Iterator[ReplayedFrame]:
        """Iterate over the used frames, in order; a frame with another time in the recording is omitted.

        Parameters
        ----------
        timestamp_of : callable
            Seconds of a frame of the recording.
        """
        boxes: dict[int, Box] = {}
        for index, pose in self._poses.items():
            if number(pose.timestamp_s, LENGTH) != number(timestamp_of(index), LENGTH):
                continue
            sightings = tuple(self._sightings.get(index, ()))
            boxes.update((row.label, row.box) for row in sightings)
            seen = {row.label for row in sightings}
            hidden = tuple(
                ReplayedObject(label, box)
                for label, box in sorted(boxes.items())
                if label not in seen and label in self._lasting
            )
            proposals = tuple(self._proposals.get(index, ()))
            yield ReplayedFrame(index, pose.T_world_camera, sightings, proposals, hidden)
