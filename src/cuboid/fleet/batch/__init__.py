"""Batches: the list of recordings, their identities, and the tasks that Dask distributes.

It needs the packages of the extra `cluster`, as `cuboid.fleet.store` does.
"""

from __future__ import annotations
