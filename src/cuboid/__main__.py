"""`python -m cuboid` is the command `cuboid`."""

from __future__ import annotations

import sys

from cuboid.cli import main

if __name__ == "__main__":
    sys.exit(main())
