"""What lies in a result folder, with the recording that it is of."""

from __future__ import annotations

from functools import cached_property

from cuboid.outputs import FinishedResults
from cuboid.paths import PathLike, as_path
from cuboid.readers import Recording
from cuboid.views.replay import reopen


class FinishedRun(FinishedResults):
    """The results that `cuboid track` left in a folder, and their recording.

    Parameters
    ----------
    folder : path
        The result folder.
    recording_path : path, optional
        Where the recording lies now; None where it still is where it was.
    """

    def __init__(self, folder: PathLike, recording_path: PathLike | None = None) -> None:
        super().__init__(folder)
        self.recording_path = None if recording_path is None else as_path(recording_path)

    @cached_property
    def recording(self) -> Recording:
        """The recording of the results.

        Raises
        ------
        InputError
            It is not there, or is another one.
        """
        return reopen(self, self.recording_path)
