from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from made_run import FRAMES, finished

from cuboid.results.files import Results
from fakes import write_recording


@pytest.fixture
def make_run(tmp_path: Path) -> Callable[[float], Results]:
    """Return a function that makes results of a camera that looks down by so many degrees."""

    def make(down_deg: float) -> Results:
        recording = write_recording(tmp_path / "recording", FRAMES)
        return Results(finished(tmp_path / "results", recording, down_deg))

    return make


@pytest.fixture
def run(make_run: Callable[[float], Results]) -> Results:
    return make_run(30.0)
