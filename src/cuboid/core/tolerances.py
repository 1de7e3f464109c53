"""Tolerances on which stages must agree: errors of sensors and of poses."""

from __future__ import annotations

# A reading lies on a surface within this many standard deviations of its noise: 99.7 of 100 do. Two readings of one
# surface differ by no more than this many: their difference has 1.4 times the deviation.
SIGMAS, JUMP_SIGMAS = 3.0, 4.0
# No reading is truer than this, metres: steps of depth, calibration.
MIN_SIGMA_M = 0.001
# Where depth is systematically off (lens, baseline) it is by about this, metres.
BIAS_M = 0.005
# Steps in depth below this, beyond noise, part no surfaces, metres: at 1 m those of one that is tilted by 75 degrees.
JUMP_M = 0.01
# Poses err, and with them the map, by about this, metres and radians: hands shake, keyframes drift.
DRIFT_M, DRIFT_RAD = 0.03, 0.02
# Points nearer than this to the camera's plane are not in its picture, metres: poses err by as much.
NEAREST_M = DRIFT_M
# Fewer readings, points or voxels say nothing of where something is, or whether it is.
MIN_READINGS = 8
# Fraction of the points of an object that may be outliers, at each side.
OUTLIER_FRACTION = 0.01
# A detector looks at one frame in this many: one that takes as long as all the rest then adds a third to the time of a
# frame on average, and nothing to the median.
DETECT_EVERY = 3
