from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cuboid.lab.synthetic import make_scene, render_recording

FRAMES, SIZE = 12, (96, 72)


@pytest.fixture
def contents() -> Callable[[Path], dict[str, bytes]]:
    """Return a function that returns the content of each file of a folder."""
    return lambda path: {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a table in clean depth, 12 frames of 96x72."""
    path = tmp_path_factory.mktemp("synthetic") / "table"
    render_recording(make_scene("table", 1, frames=FRAMES), path, sensor="clean", size=SIZE)
    return path
