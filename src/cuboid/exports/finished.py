"""What lies in a result folder, with the recording that it is of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from cuboid.outputs import FinishedResults
from cuboid.readers import Recording
from cuboid.views.replay import reopen


@dataclass(frozen=True)
class FinishedRun(FinishedResults):
    """The results that `cuboid track` left in a folder, and their recording.

    Attributes
    ----------
    folder : Path
        The result folder.
    recording_path : Path or None
        Where the recording lies now; None where it still is where it was.
    """

    recording_path: Path | None = None

    @cached_property
    def recording(self) -> Recording:
        """The recording of the results.

        Raises
        ------
        InputError
            It is not there, or is another one.
        """
        return reopen(self, self.recording_path)
