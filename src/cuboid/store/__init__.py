"""The store: what was found in many recordings, as Parquet tables that others read too.

It needs the packages of the extra `cluster`; `cuboid.core.extras` says in one line where they are missing.
"""

from __future__ import annotations
