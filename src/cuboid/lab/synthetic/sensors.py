"""The depth sensors by name: published noise models, and devices with the holes and edges of real recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cuboid.ground.arrays import Float32Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.lab.synthetic.devices import azure_kinect, iphone_lidar, kinect_v1, realsense_d435
from cuboid.lab.synthetic.noise_models import clean, structured_light, time_of_flight
from cuboid.lab.synthetic.sensor_effects import Seen

Sensor = Callable[[Seen, Intrinsics, np.random.Generator], Float32Array]

SENSORS: Mapping[str, Sensor] = {
    "structured-light": structured_light,
    "time-of-flight": time_of_flight,
    "clean": clean,
    "kinect-v1": kinect_v1,
    "realsense-d435": realsense_d435,
    "azure-kinect": azure_kinect,
    "iphone-lidar": iphone_lidar,
}
