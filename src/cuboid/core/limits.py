"""How much one frame may bring: the least likely of what is beyond is left out, so that no frame takes long.

At 640 x 480 a frame that is full to these limits takes less than half a second of one core, whatever it shows.
"""

from __future__ import annotations

# Of any source; the program's own ones give 140 at most.
MAX_PROPOSALS = 150
# Segments of a frame, after its proposals were split at depth jumps: a desk full of things has some fifty.
MAX_SEGMENTS = 150
# Objects in view without a label: what hostile depth begins in ten frames; a room full of things has some fifty.
MAX_CANDIDATES = 200

# Points of one object that are examined where all would take long: more do not change the answer.
SAMPLE_POINTS = 400

# By what they are called in `run.json`.
LIMITS = {"proposals": MAX_PROPOSALS, "clusters": MAX_SEGMENTS, "candidates": MAX_CANDIDATES}
# Memory of the process beyond which parts of the map that are out of view are evicted, in units of 2**20 bytes.
MEMORY_MB = 512.0
