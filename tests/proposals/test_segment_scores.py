"""The fitted score of the segments of a frame."""

from __future__ import annotations

import numpy as np
from two_colors import enlarged, picture

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.working import thin
from cuboid.method.proposals import make_source
from cuboid.method.proposals.forest import fitted_forest
from cuboid.method.proposals.kernels import forest
from cuboid.method.proposals.region_maps import ReducedFrame
from cuboid.method.proposals.regions import RegionSource
from cuboid.method.proposals.segment_scores import NO_STAGES, segment_log_odds

CAMERA = Intrinsics(450.0, 450.0, 159.5, 119.5, 320, 240)


def made_frame() -> Frame:
    color, depth_m = (enlarged(image, 5) for image in picture(4))
    return Frame(0, 0.0, color, depth_m, None)


def test_a_segment_has_the_score_of_the_candidate_with_its_pixels() -> None:
    frame = made_frame()
    _, surfaces = RegionSource(TrackerConfig()).candidates(ReducedFrame(frame, CAMERA))
    expected = np.empty(len(surfaces.found))
    forest.log_odds(surfaces.found, surfaces.usable, fitted_forest(), NO_STAGES, expected)
    largest = int(np.argmax(np.where(surfaces.usable > 0, surfaces.masks.sizes, 0)))
    x0, y0, x1, y1 = surfaces.masks.rectangles[largest]
    start = surfaces.masks.starts[largest]
    inside = surfaces.masks.flat[start : start + (x1 - x0) * (y1 - y0)].reshape(y1 - y0, x1 - x0) > 0
    claim = np.full((240, 320), -1, np.int32)
    claim[y0:y1, x0:x1][inside] = 0
    image, proposals = thin(frame, CAMERA, 320, 0), make_source("depth")(frame, CAMERA)
    found = segment_log_odds(ReducedFrame(frame, CAMERA), image, claim, 1, proposals)
    np.testing.assert_allclose(found, expected[[largest]], atol=0.2)


def test_segments_of_a_coarser_working_image_and_too_small_ones() -> None:
    """Twice the picture, with a working image of every second pixel: the same segment has nearly the same score."""
    frame, small = made_frame(), CAMERA
    image, claim = thin(frame, small, 320, 0), np.full((240, 320), -1, np.int32)
    claim[50:170, 80:220], claim[0, 0] = 0, 1
    proposals = make_source("depth")(frame, small)
    at_once = segment_log_odds(ReducedFrame(frame, small), image, claim, 2, proposals)
    assert np.isfinite(at_once[0])
    assert np.isnan(at_once[1])
    twice = Frame(0, 0.0, enlarged(frame.color, 2), enlarged(frame.depth_m, 2), None)
    large = Intrinsics(900.0, 900.0, 319.5, 239.5, 640, 480)
    for count in range(4):  # each with another offset of the subsampled pixels
        image = thin(twice, large, 320, count)
        found = segment_log_odds(ReducedFrame(twice, large), image, claim, 2, make_source("depth")(twice, large))
        assert abs(found[0] - at_once[0]) < 1.5


def test_narrow_pictures_have_no_scores() -> None:
    color, depth_m = picture(4)
    frame, camera = Frame(0, 0.0, color, depth_m, None), Intrinsics(90.0, 90.0, 31.5, 23.5, 64, 48)
    claim = np.zeros((48, 64), np.int32)
    found = segment_log_odds(
        ReducedFrame(frame, camera), thin(frame, camera, 320, 0), claim, 1, make_source("depth")(frame, camera)
    )
    assert np.isnan(found).all()
