"""Tolerances that several stages must share: errors of sensors and of poses."""

from __future__ import annotations

# A reading lies on a surface if it is within SIGMAS standard deviations of its noise: 99.7 % are. Two readings of one
# surface differ by at most JUMP_SIGMAS: the standard deviation of a difference is 1.4 times that of one reading.
SIGMAS, JUMP_SIGMAS = 3.0, 4.0
# Standard deviation of depth divided by depth squared, 1/metre: that of the first Kinect (Khoshelham and Oude Elberink,
# "Accuracy and Resolution of Kinect Depth Data", Sensors 2012), the largest of the common sensors.
DEPTH_NOISE_PER_M = 1.425e-3
# Smallest error of any depth reading, metres: depth quantisation and calibration.
MIN_SIGMA_M = 0.001
# Typical systematic depth error (lens, baseline), metres.
BIAS_M = 0.005
# Depth steps below this, beyond noise, do not separate surfaces, metres: at 1 m a surface tilted by 75 degrees.
JUMP_M = 0.01
# Typical error of poses, and so of the map, metres and radians: shaking hands, keyframe drift.
DRIFT_M, DRIFT_RAD = 0.03, 0.02
# Points nearer than this to the camera plane are treated as outside the image, metres: the size of the pose error.
NEAREST_M = DRIFT_M
# Fewer readings, points or voxels are too few to locate something or to decide whether it exists.
MIN_READINGS = 8
# Fraction of the points of an object that may be outliers, at each side.
OUTLIER_FRACTION = 0.01
# A detector processes one frame in this many: if it takes as long as all other stages together, it adds a third to the
# mean time of a frame, and nothing to the median.
DETECT_EVERY = 3
