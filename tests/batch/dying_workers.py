"""What Dask loads into each worker of a test: once a file exists, no worker starts any more."""

from __future__ import annotations

import os
from pathlib import Path

if Path(os.environ["CUBOID_TEST_NO_WORKER"]).exists():
    os._exit(1)
