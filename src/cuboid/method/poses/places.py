"""Place recognition by corner features: the most similar keyframe of an image, and its pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3

# Largest number of corners of an image: a third of them suffices if two images show the same place.
CORNERS = 400
# Height and width of a thumbnail: images that are similar at this size may show the same place.
THUMB_HW = (24, 32)
# Number of corners that vote for a place, and number of bits of 256 in which matching corners may differ.
VOTERS, SAME_BITS = 120, 50
# A match of a corner is clear if its distance is below this fraction of the second best.
CLEAR = 0.8
# Largest distance of a corner from the projected point of its keyframe, pixels.
CORNER_PX = 2.5
RANSAC_ROUNDS = 200
# Smallest number of corners that agree on a pose: more than agree by chance.
MIN_MATCHES = 15


@dataclass(frozen=True, slots=True)
class Appearance:
    """Appearance of an image.

    Attributes
    ----------
    thumb : (24 * 32,) float32
        Reduced image with mean 0 and length 1; all 0 if the image is uniform.
    corners : (N, 2) float32
        Pixels u, v of the finest level, strongest corner first.
    descriptors : (N, 32) uint8
        ORB (Rublee, Rabaud, Konolige, Bradski, ICCV 2011).
    points : (N, 3) float32
        Points of the corners in the camera frame; NaN without depth.
    """

    thumb: Float32Array
    corners: Float32Array
    descriptors: UInt8Array
    points: Float32Array


def describe(gray: UInt8Array, depth_m: Float32Array, camera: Intrinsics) -> Appearance:
    """Return the appearance of an image (h, w) with depth."""
    found, descriptors = _orb().detectAndCompute(gray, None)
    if descriptors is None:
        descriptors = np.empty((0, 32), np.uint8)
    best_first = np.argsort([-corner.response for corner in found], kind="stable")
    descriptors = np.asarray(descriptors, np.uint8)[best_first]
    corners = np.array([found[k].pt for k in best_first], np.float32).reshape(-1, 2)
    u, v = np.rint(corners).astype(int).T
    z = np.where(depth_m[v, u] > 0, depth_m[v, u], np.nan)
    points = camera.points(corners[:, 0], corners[:, 1], z).astype(np.float32)
    return Appearance(thumbnail(gray), corners, descriptors, points)


def thumbnail(gray: UInt8Array) -> Float32Array:
    """Return a reduced image of an image (h, w), with mean 0 and length 1; all 0 if the image is uniform."""
    import cv2

    small = cv2.resize(gray, THUMB_HW[::-1], interpolation=cv2.INTER_AREA).astype(np.float32).reshape(-1)
    small -= small.mean()
    length = float(np.linalg.norm(small))
    # less than two grey levels of contrast is noise
    return np.asarray(small / length if length > 2.0 * np.sqrt(small.size) else 0.0 * small, np.float32)


def votes(seen: Appearance, others: Sequence[Appearance]) -> Float64Array:
    """Return the similarity of each of the other images to one, (N,): the fraction of its strongest corners that match.

    Each corner votes for the image with the most similar corner. The correlation of the thumbnails has the weight of a
    tenth of the corners, so that images without corners are ordered, too.
    """
    if not others:
        return np.empty(0)
    counts = 0.1 * (np.stack([other.thumb for other in others]).astype(np.float64) @ seen.thumb)
    sizes = [len(other.descriptors[:VOTERS]) for other in others]
    voters = seen.descriptors[:VOTERS]
    if not len(voters) or not sum(sizes):
        return np.asarray(counts)
    image = np.repeat(np.arange(len(others)), sizes)
    for match in _matcher().match(voters, np.concatenate([other.descriptors[:VOTERS] for other in others])):
        if match.distance <= SAME_BITS:
            counts[image[match.trainIdx]] += 1.0 / len(voters)
    return np.asarray(counts)


def locate(seen: Appearance, keyframe: Appearance, camera: Intrinsics) -> Float64Array | None:
    """Find the pose of an image with respect to a keyframe by the corners that both show.

    Parameters
    ----------
    seen, keyframe : Appearance
        Appearance of the image and of the keyframe.
    camera : Intrinsics
        Of the image.

    Returns
    -------
    (4, 4) float64 or None
        T_camera_keyframe; None if the images have too little in common.
    """
    import cv2

    deep = np.isfinite(keyframe.points[:, 2])
    if np.count_nonzero(deep) < MIN_MATCHES or len(seen.corners) < MIN_MATCHES:
        return None
    pairs = _matcher().knnMatch(keyframe.descriptors[deep], seen.descriptors, k=2)
    good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < CLEAR * p[1].distance]
    if len(good) < MIN_MATCHES:
        return None
    points = keyframe.points[deep][[m.queryIdx for m in good]].astype(np.float64)
    pixels = seen.corners[[m.trainIdx for m in good]].astype(np.float64)
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    # OpenCV uses the same random seed in each call
    success, turn, shift, inliers = cv2.solvePnPRansac(
        points, pixels, K, None, iterationsCount=RANSAC_ROUNDS, reprojectionError=CORNER_PX, flags=cv2.SOLVEPNP_EPNP
    )
    if not success or inliers is None or len(inliers) < MIN_MATCHES:
        return None
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(turn)[0]
    T[:3, 3] = shift.reshape(3)
    return se3.tidied(T)


@cache
def _orb() -> Any:
    import cv2

    return cv2.ORB.create(nfeatures=CORNERS, nlevels=5, fastThreshold=10)


@cache
def _matcher() -> Any:
    import cv2

    return cv2.BFMatcher(cv2.NORM_HAMMING)
