"""The store: results of many recordings as Parquet tables that other programs can read.

It needs the packages of the extra `cluster`; if they are missing, `cuboid.ground.core.extras` raises an error of one
line.
"""

from __future__ import annotations
