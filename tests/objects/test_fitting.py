"""When the box of an object is fitted: what of it is the table's."""

from __future__ import annotations

import numpy as np
import pytest
from made_maps import box_of, grid, map_of, shell

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.geometry.overlap import iou
from cuboid.method.objects.affinity import SAME_LOG_ODDS
from cuboid.method.objects.boxing import Boxing
from cuboid.method.objects.entry import MapObject, State
from cuboid.method.objects.fitting import Fitting
from cuboid.method.objects.store import ObjectStore
from cuboid.method.surfaces.cells import Cells
from cuboid.method.surfaces.kernels.outlines import FREE, HIDDEN, TOP
from cuboid.method.surfaces.planes import PlaneTracker
from cuboid.method.surfaces.standing import FlatAreas

# A camera that is held upright and looks along y.
LEVEL = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
JAR = shell((0.3, 0.4), (0.3, 0.4), (0.0, 0.16))
NOTHING = np.zeros((0, 3))
# Where the camera is.
EYE = np.array([0.0, -1.0, 1.0])


def table() -> Cells:
    """Flat cells at height 0, 6 cm wide each, from the origin on."""
    i, j = (a.ravel() for a in np.mgrid[:14, :14])
    return Cells(
        places=np.tile(np.arange(len(i))[:, None], (1, 4)),
        normal=np.tile([0.0, 0.0, 1.0], (len(i), 1)),
        center=np.column_stack([0.06 * i, 0.06 * j, np.zeros(len(i))]),
        area_m2=np.full(len(i), 0.0036),
        sigma_m=np.full(len(i), 0.002),
        image_shape=(14, 14),
    )


def seen(points: np.ndarray, ground: np.ndarray = NOTHING) -> tuple[Fitting, MapObject]:
    """An object of these points that was seen above the table, which has stood for 500 pixels beneath it."""
    planes, voxels, config = PlaneTracker(TrackerConfig()), map_of((points, 1), (ground, 0)), TrackerConfig()
    for frame in range(4):
        planes.vote_up(FlatAreas(np.array([[0.0, 0.0, 1.0]]) @ LEVEL[:3, :3], np.ones(1), np.ones(1)), LEVEL)
        planes.update(frame, table())
    store = ObjectStore(voxels)
    entry = store.add(box_of(points), 0)
    entry.sightings, entry.supports = 5, {planes.planes[0].identity: 500}
    return Fitting(config, voxels, planes, store, Boxing(voxels)), entry


def fitted(points: np.ndarray, ground: np.ndarray = NOTHING) -> MapObject:
    fitting, entry = seen(points, ground)
    fitting.fit(entry)
    assert entry.plane in (fitting._planes.planes[0].identity, None)
    return entry


def test_the_rim_of_the_table_that_came_with_an_object_is_no_part_of_its_box() -> None:
    rim = grid((0.1, 0.6), (0.2, 0.24), (-0.04, 0.0))[::4]
    assert 4 * len(rim) > len(JAR)
    entry = fitted(np.concatenate([JAR, rim]))
    assert iou(entry.box, box_of(JAR)) > 0.75
    assert (entry.points[:, 2] > 0.0).all()


def test_what_lies_flat_on_the_table_keeps_its_points() -> None:
    card = grid((0.3, 0.4), (0.3, 0.4), (-0.005, 0.008))
    assert len(fitted(card).points) > 50


def test_what_floats_above_its_plane_is_told_anew_by_what_follows_what_it_stands_on() -> None:
    """A shelf that is found after what stands on it was seen: counts of the floor beneath must not outweigh it."""
    ground = grid((0.0, 0.8), (0.0, 0.8), (0.0, 0.01))
    above_support_rim, floating = fitted(JAR), fitted(JAR + np.array([0.0, 0.0, 0.4]), ground)
    assert above_support_rim.supports == {above_support_rim.plane: 500}
    assert floating.supports == {floating.plane: 1}


def test_what_stands_on_a_shelf_of_which_only_the_rim_was_seen_has_a_box_of_its_own() -> None:
    jar = JAR + np.array([0.0, 0.0, 0.6])
    rim = grid((0.1, 0.45), (0.2, 0.24), (0.56, 0.59))
    entry = fitted(np.concatenate([jar, rim]))
    assert entry.plane is None, "it stands on what is not known yet"
    assert (entry.points[:, 2] > 0.59).all()
    assert iou(entry.box, box_of(jar)) > 0.7
    assert entry.supports, "the next fit has to know what it does not stand on"


def test_a_label_has_its_box_fitted_anew_when_more_was_seen_and_from_one_place_when_as_much_again_was() -> None:
    fitting, entry = seen(JAR)
    entry.state, entry.label, fits = State.CONFIRMED, 1, []
    for sightings in range(1, 12):
        entry.sightings = sightings
        fitting.fit_grown([entry.number], EYE, new_viewpoint=False)
        fits.append(entry.fitted)
    assert fits == [1, 2, 2, 4, 4, 4, 4, 8, 8, 8, 8]
    fitting.fit_grown([entry.number], EYE, new_viewpoint=True)
    assert entry.fitted == 11
    entry.sightings = 12
    fitting.fit_grown([entry.number], EYE, new_viewpoint=True)
    assert entry.fitted == 11


def test_a_candidate_before_a_fixed_camera_has_its_box_fitted_anew_when_half_as_much_again_was_seen() -> None:
    fits: dict[bool, list[int]] = {}
    for fixed in (False, True):
        fitting, entry = seen(JAR)
        fits[fixed] = []
        for sightings in range(2, 12):
            entry.sightings = sightings
            fitting.fit_grown([entry.number], EYE, new_viewpoint=False, fixed=fixed)
            fits[fixed].append(entry.fitted)
    assert fits == {False: [2, 3, 4, 5, 6, 7, 7, 9, 9, 11], True: [2, 3, 3, 5, 5, 5, 8, 8, 8, 8]}


@pytest.mark.parametrize(
    ("above", "top_m", "state"),
    [
        (HIDDEN, -0.05, State.RETIRED),  # a leg beneath the board
        (FREE, -0.05, State.CONFIRMED),  # a bin that is nearly as high
        (FREE, 0.01, State.RETIRED),  # the side of a shelf, as high as its board
    ],
)
def test_what_goes_up_to_the_table_loses_its_label_but_where_it_ends_below(
    above: int, top_m: float, state: State
) -> None:
    fitting, leg = seen(shell((0.3, 0.36), (0.3, 0.36), (-0.5, top_m)))
    leg.supports = {}  # the floor was never seen
    leg.state, leg.probability = State.CONFIRMED, 0.9
    leg.outline[TOP, above] = 20
    for _ in range(2):
        assert leg.confirmed
        fitting.fit(leg)
        assert leg.supports_plane is (state is State.RETIRED)
    assert leg.state is state


@pytest.mark.parametrize(
    ("other", "same"),
    [
        (shell((0.3, 0.4), (0.32, 0.4), (0.0, 0.16)), True),  # 0.8 of the jar
        (shell((0.3, 0.4), (0.3, 0.4), (0.0, 0.06)), False),  # 0.375: its box may be that of a part
        (shell((0.42, 0.52), (0.3, 0.4), (0.0, 0.16)), False),  # beside it
    ],
)
def test_a_fit_tells_that_a_labelled_object_in_the_same_place_is_the_same_one(other: np.ndarray, same: bool) -> None:
    fitting, jar = seen(JAR)
    second = fitting._store.add(box_of(other), 0)
    second.points = other.astype(np.float32)
    fitting.fit(jar)
    assert not fitting._store.affinity.of(1, 2), "neither has a label"
    fitting._store.confirm(second)
    fitting.fit(jar)
    assert (fitting._store.affinity.of(1, 2) or 0.0) == pytest.approx(SAME_LOG_ODDS if same else 0.0)
    jar.moved = True
    fitting.fit(jar)
    assert (fitting._store.affinity.of(1, 2) or 0.0) == pytest.approx(SAME_LOG_ODDS if same else 0.0)


@pytest.mark.parametrize(("log_odds", "furniture"), [(0.0, True), (-1.0, True), (1.0, False)])
def test_an_object_that_covers_its_own_part_is_no_furniture(log_odds: float, furniture: bool) -> None:
    """A plant covers its pot, which one camera shows apart from it; a shelf covers what stands in it."""
    whole = np.concatenate([shell((0.2, 0.24), (0.3, 0.42), (0.0, 0.3)), grid((0.2, 0.44), (0.3, 0.42), (0.2, 0.21))])
    fitting, cover = seen(whole)
    pot = fitting._store.add(box_of(shell((0.3, 0.37), (0.32, 0.39), (0.0, 0.1))), 0)
    pot.points = shell((0.3, 0.37), (0.32, 0.39), (0.0, 0.1)).astype(np.float32)
    for one in (cover, pot):
        fitting._store.confirm(one)
    fitting._store.add_pair_evidence(cover, pot, log_odds, novelty=1.0)
    fitting.fit(cover)
    assert cover.supports_plane is furniture
