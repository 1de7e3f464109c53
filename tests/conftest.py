from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run; the first one of a kernel also compiles it, which no deadline allows for.
settings.register_profile("cuboid", deadline=None, derandomize=True)
settings.load_profile("cuboid")

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real recordings; without them the test skips, in CI it fails."""
    folder = Path(os.environ.get("CUBOID_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        message = f"no real recordings at {folder} (set CUBOID_DATA to their folder)"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return folder
