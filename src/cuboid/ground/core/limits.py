"""Limits of the work for one frame: the least likely items beyond a limit are dropped, so that no frame takes long.

At 640 x 480 a frame that reaches all limits takes less than half a second on one core, whatever it shows.
"""

from __future__ import annotations

# Proposals of a frame, from any source; Cuboid's own sources give at most 140.
MAX_PROPOSALS = 150
# Segments of a frame, after its proposals were split at depth jumps: a crowded desk has about fifty.
MAX_SEGMENTS = 150
# Visible objects without a label: hostile depth starts this many in ten frames; a crowded room has about fifty.
MAX_CANDIDATES = 200

# Points per object that are sampled for expensive checks: more points do not change the result.
SAMPLE_POINTS = 400

# The limits by their names in `run.json`.
LIMITS = {"proposals": MAX_PROPOSALS, "clusters": MAX_SEGMENTS, "candidates": MAX_CANDIDATES}
# Memory of the process in units of 2**20 bytes; above it, parts of the map that are out of view are evicted.
MEMORY_MB = 512.0
# Size of one value in a scene file, bytes: above it the file is damaged, and the value is not read. The longest text
# that a scene allows, the settings of a rig, has 200 million characters.
MAX_SCENE_VALUE_BYTES = 2**28
# Number of frames of a live camera that wait for the tracker: at 30 Hz a delay of 0.1 s drops none, and no frame is
# older than that.
FRAMES_WAITING = 4
