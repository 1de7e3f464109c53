from __future__ import annotations

from pathlib import Path

import pytest
from made_recordings import Made, make_plain


@pytest.fixture
def plain(tmp_path: Path) -> Made:
    """A plain folder of five whole frames with poses."""
    return make_plain(tmp_path)
