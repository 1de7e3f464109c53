"""The user's settings of the tracker: each field with its meaning, unit and range."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cuboid.ground.core.errors import ConfigError
from cuboid.ground.core.tolerances import DEPTH_NOISE_PER_M


def _field(default: Any, low: float, high: float, unit: str) -> Any:
    return field(default=default, metadata={"low": low, "high": high, "unit": unit})


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """Settings of the tracker; none of them depends on a recording.

    Attributes
    ----------
    voxel_m : float
        Edge of a voxel of the global map, metres. Two objects stay apart when their gap is about two voxels.
    max_depth_m : float
        Depth readings beyond this are ignored, metres: there the noise of a structured-light sensor nears 2 cm.
    depth_noise_per_m : float
        The standard deviation of depth at distance z is this value times z squared, 1/metre (Khoshelham and Elberink
        2012 give 1.425e-3 for the first Kinect; a time-of-flight sensor has less noise beyond 2 m).
    working_width_px : int
        Frames are subsampled, each with another pixel offset, until their longer side is less than twice this value,
        pixels. At 320 and 1.5 m a pixel is 6 mm, less than a voxel; 160 takes half the time and finds objects of 5 cm
        up to 2 m away.
    min_height_m : float
        Points less than this above a supporting plane are attributed to the noise of the plane, metres.
    min_size_m : float
        At least two sides of an object have this length, metres: with only one long side it is a rim or an edge.
    max_size_m : float
        The longest side of an object is at most this, metres.
    min_plane_area_m2 : float
        A horizontal surface smaller than this is the lid of an object, not a supporting plane, square metres.
    hot : float
        Points with at least this heat belong to objects, 0..1.
    min_probability : float
        Objects with at least this probability get a label, 0..1. An object whose probability falls below it afterwards
        keeps its label, and no result contains it until its probability has risen again. A lower value finds more
        objects, a higher one fewer false ones.
    region_probability : float
        Objects that only regions of color and depth show, not depth alone, get a label from this probability on, 0..1;
        with 1 there are none.
    """

    voxel_m: float = _field(0.01, 0.003, 0.1, "m")
    max_depth_m: float = _field(3.5, 0.5, 20.0, "m")
    depth_noise_per_m: float = _field(DEPTH_NOISE_PER_M, 1e-5, 0.05, "1/m")
    working_width_px: int = _field(320, 80, 2560, "pixels")
    min_height_m: float = _field(0.01, 0.003, 0.2, "m")
    min_size_m: float = _field(0.03, 0.01, 1.0, "m")
    max_size_m: float = _field(1.0, 0.05, 5.0, "m")
    min_plane_area_m2: float = _field(0.08, 0.005, 10.0, "m2")
    hot: float = _field(0.3, 0.01, 0.99, "")
    min_probability: float = _field(0.35, 0.01, 0.99, "")
    region_probability: float = _field(0.5, 0.1, 1.0, "")

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value, low, high = getattr(self, item.name), item.metadata["low"], item.metadata["high"]
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ConfigError(f"{item.name} must be a number, got {value!r}")
            if item.type == "int" and not isinstance(value, int):
                raise ConfigError(f"{item.name} must be a whole number, got {value!r}")
            if not low <= value <= high:
                unit = f" {item.metadata['unit']}" if item.metadata["unit"] else ""
                raise ConfigError(f"{item.name} must lie in {low}..{high}{unit}, got {value}")
        if self.min_size_m >= self.max_size_m:
            raise ConfigError(f"min_size_m ({self.min_size_m}) must be below max_size_m ({self.max_size_m})")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> TrackerConfig:
        """Make a configuration from names and values; a value given as text is converted to a number.

        Raises
        ------
        ConfigError
            If a name is unknown, or a value is not a number in its range.
        """
        fields = {item.name: item for item in dataclasses.fields(cls)}
        numbers: dict[str, Any] = {}
        for name, value in values.items():
            if name not in fields:
                raise ConfigError(f"unknown setting '{name}'; there are: {', '.join(fields)}")
            kind: type[int] | type[float] = int if fields[name].type == "int" else float
            try:
                numbers[name] = kind(value) if isinstance(value, str) else value
            except ValueError:
                raise ConfigError(f"{name} must be a number, got {value!r}") from None
        return cls(**numbers)

    def to_dict(self) -> dict[str, float | int]:
        """Return names and values."""
        return dataclasses.asdict(self)

    def within_range(self, **values: float) -> TrackerConfig:
        """Return these settings with other values, each clipped to the range of its field."""
        ranges = {item.name: (item.metadata["low"], item.metadata["high"]) for item in dataclasses.fields(self)}
        clipped = {name: min(max(value, ranges[name][0]), ranges[name][1]) for name, value in values.items()}
        return dataclasses.replace(self, **clipped)
