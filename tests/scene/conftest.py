from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from made_scene import Shown, record


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of two things, which nobody changes."""
    path = tmp_path_factory.mktemp("scene") / "made.cuboid"
    record(path, Shown())
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    """A copy of the scene."""
    return Path(shutil.copy(made, tmp_path / "made.cuboid"))
