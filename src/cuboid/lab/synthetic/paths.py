"""Camera paths: waypoints, the curve through them at the speed of a hand or a drone, and its tremble."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic.mesh import turn
from cuboid.lab.synthetic.scene import FRAMES_PER_S

# Maximum motion per frame at 30 frames per second: 0.5 m/s, 36 degrees/s.
MAX_STEP_M = 0.0165
MAX_STEP_RAD = np.radians(1.2)
# The camera's inertia: its path is smoothed over this many frames.
INERTIA_FRAMES = 5.0
# Number of points on the curve through all waypoints; poses are interpolated between them.
_PIECES = 2400


@dataclass(frozen=True, slots=True)
class Style:
    """The motion style of a camera.

    Attributes
    ----------
    sway_m, sway_rad : float
        Amplitude of the slow sway in position and direction.
    hertz : float
        Highest frequency of the sway.
    bank : float
        Roll in curves: radians per sideways metre per frame.
    """

    sway_m: float
    sway_rad: float
    hertz: float
    bank: float


CAMERAS = {
    "orbit": Style(0.0015, np.radians(0.1), 0.5, 0.0),
    "handheld": Style(0.012, np.radians(0.7), 1.3, 0.0),
    "drone": Style(0.02, np.radians(0.5), 0.4, 6.0),
}


# A camera on a stand, which trembles by a fraction of a millimetre.
STILL = Style(0.0002, np.radians(0.01), 0.5, 0.0)


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike) -> Float64Array:
    """Return T_room_camera (4, 4) of an upright camera at `eye` that looks at `target`."""
    place = np.asarray(eye, np.float64)
    forward = np.asarray(target, np.float64) - place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return se3.assembled(np.column_stack([right, np.cross(forward, right), forward]), place)


def fly(waypoints: npt.ArrayLike, frames: int, style: Style, rng: np.random.Generator, *, whole: bool) -> Float64Array:
    """Return the poses (frames, 4, 4) of a camera that passes waypoints (K, 6) of eye and target.

    The speed is constant and at most `MAX_STEP_M` and `MAX_STEP_RAD` per frame. If there are too few frames, the path
    ends early; with `whole` it is flown faster instead.
    """
    from scipy.interpolate import PchipInterpolator
    from scipy.ndimage import gaussian_filter1d

    points = np.asarray(waypoints, np.float64)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1) + 1e-6)])
    curve = PchipInterpolator(knots, points)(np.linspace(0, knots[-1], _PIECES))
    forward = curve[:, 3:] - curve[:, :3]
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    moved = np.linalg.norm(np.diff(curve[:, :3], axis=0), axis=1) / MAX_STEP_M
    turned = np.linalg.norm(np.diff(forward, axis=0), axis=1) / MAX_STEP_RAD
    clock = np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned) + 1e-9)])
    end = clock[-1] if whole else min(clock[-1], float(max(frames - 1, 1)))
    at = np.linspace(0, end, frames)
    trajectory = np.column_stack([np.interp(at, clock, column) for column in curve.T])
    trajectory = gaussian_filter1d(trajectory, INERTIA_FRAMES, axis=0, mode="nearest")
    return _held_camera(trajectory, style, rng)


def _held_camera(trajectory: Float64Array, style: Style, rng: np.random.Generator) -> Float64Array:
    frames = len(trajectory)
    sway = smooth_noise(frames, 6, style.hertz, rng) * ([style.sway_m] * 3 + [style.sway_rad] * 3)
    velocity = np.gradient(trajectory[:, :3], axis=0) if frames > 1 else np.zeros((1, 3))
    poses = np.empty((frames, 4, 4))
    for k in range(frames):
        level = look_at(trajectory[k, :3], trajectory[k, 3:])
        roll = style.bank * float(velocity[k] @ level[:3, 0]) + sway[k, 5]
        poses[k] = level @ turn(sway[k, 3], 0) @ turn(sway[k, 4], 1) @ turn(roll, 2)
        poses[k, :3, 3] += sway[k, :3]
    return poses


def smooth_noise(frames: int, channels: int, hertz: float, rng: np.random.Generator) -> Float64Array:
    """Return noise (frames, channels) of deviation 1 without frequencies above `hertz`."""
    waves = 7
    frequency = hertz * rng.uniform(0.15, 1.0, (waves, channels))
    phase = rng.uniform(0, 2 * np.pi, (waves, channels))
    seconds = np.arange(frames)[:, None, None] / FRAMES_PER_S
    noise: Float64Array = np.sin(2 * np.pi * frequency * seconds + phase).sum(axis=1) * np.sqrt(2 / waves)
    return noise


def around(
    center: npt.ArrayLike, angles_rad: npt.ArrayLike, radius_m: npt.ArrayLike, height_m: npt.ArrayLike
) -> Float64Array:
    """Return waypoints (K, 6) on an arc around a point (3,), looking at it; heights are above the floor."""
    angle, radius, height = np.broadcast_arrays(np.asarray(angles_rad, np.float64), radius_m, height_m)
    middle = np.asarray(center, np.float64)
    eye = np.column_stack([middle[0] + radius * np.cos(angle), middle[1] + radius * np.sin(angle), height])
    return np.column_stack([eye, np.broadcast_to(middle, eye.shape)])


def random_motion(rng: np.random.Generator) -> Float64Array:
    """Return a random motion (4, 4): a uniformly distributed rotation, and a translation of some metres."""
    return se3.compose(rng.standard_normal(4), rng.uniform(-2, 2, 3))


PoseNoise = Callable[[Float64Array, np.random.Generator], Float64Array]

# Standard deviation of the error of each frame, which accumulates: after 200 frames about 1.4 cm and 0.4 degrees, as
# with good odometry without loop closure around a table.
FRAME_DRIFT_M, FRAME_DRIFT_RAD = 0.001, np.radians(0.03)
# A jump, as when tracking is lost and recovered: mean interval (frames), range of translation and rotation, range of
# duration (frames).
JUMP_EVERY_FRAMES = 45
JUMP_RANGE_M, JUMP_RANGE_RAD = (0.01, 0.035), (np.radians(0.4), np.radians(1.5))
JUMP_FRAMES = (6, 20)


def none(T_world_camera: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return the poses (N, 4, 4) unchanged."""
    return T_world_camera


def drift(T_world_camera: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return poses (N, 4, 4) with errors that accumulate from frame to frame; the first pose is exact."""
    wrong = np.empty_like(T_world_camera)
    wrong[0] = T_world_camera[0]
    for k in range(1, len(wrong)):
        step = se3.inverse(T_world_camera[k - 1]) @ T_world_camera[k]
        wrong[k] = wrong[k - 1] @ step @ _small(rng.normal(0, FRAME_DRIFT_M, 3), rng.normal(0, FRAME_DRIFT_RAD, 3))
    return wrong


def jumps(T_world_camera: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return poses (N, 4, 4) with occasional errors of a few centimetres that last for some frames."""
    wrong = T_world_camera.copy()
    k = int(rng.integers(10, JUMP_EVERY_FRAMES))
    while k < len(wrong):
        direction, axis = rng.standard_normal((2, 3))
        off = _small(
            direction / np.linalg.norm(direction) * rng.uniform(*JUMP_RANGE_M),
            axis / np.linalg.norm(axis) * rng.uniform(*JUMP_RANGE_RAD),
        )
        end = k + int(rng.integers(*JUMP_FRAMES))
        wrong[k:end] = wrong[k:end] @ off
        k = end + int(rng.integers(JUMP_EVERY_FRAMES // 2, JUMP_EVERY_FRAMES * 3 // 2))
    return wrong


POSE_NOISES: Mapping[str, PoseNoise] = {"none": none, "drift": drift, "jumps": jumps}


def _small(translation: Float64Array, rotation_rad: Float64Array) -> Float64Array:
    """Return the motion (4, 4) of a translation and a small rotation vector."""
    return se3.compose((1.0, *(rotation_rad / 2)), translation)
