"""The store of all objects: the modules of this package are the only code that changes an object.

Each change is a method of `ObjectStore`, whose docstring gives the invariant that it keeps. All other code reads.

| module | contents |
|---|---|
| `boxes` | the table of the boxes |
| `objects` | all objects by number, and searches among them |
| `evidence` | evidence, box and points of an object; evidence on pairs |
| `without_depth` | evidence and position of an object without depth |
| `labels` | the life of a label: candidate, confirmed, retired, moved, merged, taken over |
"""

from __future__ import annotations

from cuboid.method.objects.store.labels import ObjectStore, ObjectStoreState

__all__ = ["ObjectStore", "ObjectStoreState"]
