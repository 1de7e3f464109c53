from __future__ import annotations

import numpy as np
from posed_pictures import CAMERA, black, camera_path, picture

from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.method.poses.places import Appearance, describe, locate, votes
from cuboid.method.poses.pyramid import shrink

PATH = camera_path(25, 150.0)


def looks(frame: Frame) -> Appearance:
    gray, depth_m, _ = shrink(frame, CAMERA)
    return describe(gray, depth_m, CAMERA)


def test_an_image_votes_for_the_place_that_it_shows() -> None:
    known = [looks(picture(PATH[k], k)) for k in (0, 6, 12, 18, 24)]
    fractions = votes(looks(picture(PATH[13], 13)), known)
    assert int(np.argmax(fractions)) == 2
    assert fractions[2] > 0.12


def test_a_pose_is_found_without_knowing_where_to_look() -> None:
    known, seen = looks(picture(PATH[12], 12)), looks(picture(PATH[14], 14))
    T = locate(seen, known, CAMERA)
    assert T is not None
    away = se3.log(T @ se3.inverse(se3.inverse(PATH[14]) @ PATH[12]))
    assert np.linalg.norm(away[:3]) < 0.06
    assert np.degrees(np.linalg.norm(away[3:])) < 3.0


def test_a_covered_lens_looks_like_nothing() -> None:
    dark, known = looks(black(0)), looks(picture(PATH[0], 0))
    assert len(dark.corners) == 0
    assert locate(dark, known, CAMERA) is None
    assert locate(known, dark, CAMERA) is None
    np.testing.assert_array_equal(votes(dark, [known]), [0.0])
    assert len(votes(known, [])) == 0


def test_another_place_is_not_taken_for_a_known_one() -> None:
    assert locate(looks(picture(PATH[24], 24)), looks(picture(PATH[0], 0)), CAMERA) is None
