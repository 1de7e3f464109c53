from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cuboid.ground.core.errors import InputError
from cuboid.lab.synthetic import KINDS, make_scene, make_visits, render_recording
from cuboid.lab.synthetic.looks import STYLES
from cuboid.lab.synthetic.material import Material, Texture
from cuboid.lab.synthetic.mesh import box
from cuboid.lab.synthetic.sensors import SENSORS
from cuboid.lab.synthetic.shapes import Model
from cuboid.lab.synthetic.view import SceneView

SIZE = (64, 48)
# The mean color of the quarters of frame 0 in the style plain (upper left, upper right, lower left, lower right), and
# the mean depth in centimetres: they have not changed since styles exist. Bytes are not compared, because they differ
# between versions of the ray caster and of the JPEG library.
PLAIN = {
    "table": [117, 101, 82, 133, 114, 107, 152, 108, 72, 121, 77, 52, 226],
    "shelf": [149, 137, 121, 161, 154, 145, 147, 142, 131, 158, 151, 143, 99],
}


def summary(rendered) -> list[int]:
    quarters = cv2.resize(rendered.color, (2, 2), interpolation=cv2.INTER_AREA).reshape(-1).tolist()
    return [*quarters, round(100 * float(rendered.depth_m.mean()))]


@pytest.mark.parametrize("kind", PLAIN)
def test_plain_is_the_default_and_looks_as_ever(kind):
    assert STYLES[0] == "plain"
    scenes = make_scene(kind, 1, frames=3), make_scene(kind, 1, frames=3, style="plain")
    default, plain = (SceneView(s, s.intrinsics(*SIZE)).render(0, "structured-light") for s in scenes)
    np.testing.assert_array_equal(default.color, plain.color)
    np.testing.assert_array_equal(default.depth_m, plain.depth_m)
    np.testing.assert_allclose(summary(plain), PLAIN[kind], atol=1)


@pytest.mark.parametrize("kind", ["table", "moving", "shelf"])
def test_both_styles_have_the_same_geometry(kind, tmp_path, contents):
    """All files but the color images and the colors of the cloud are equal, byte by byte."""
    for style in STYLES:
        scene = make_scene(kind, 3, frames=4, style=style)
        render_recording(scene, tmp_path / style, sensor="time-of-flight", size=SIZE)
    plain, real = (contents(tmp_path / style) for style in STYLES)
    differ = {name for name in plain if plain[name] != real[name]}
    assert plain.keys() == real.keys()
    assert differ == {"true_cloud.ply", *(name for name in plain if name.startswith("color"))}


@pytest.mark.parametrize("kind", KINDS)
def test_every_sensor_measures_every_kind(kind):
    """Fill of the depth image and error against the true depth; the median error is below 6 cm.

    Depth is the same in both styles, which another test asserts.
    """
    scene = make_scene(kind, 2, frames=2, style="real")
    view = SceneView(scene, scene.intrinsics(*SIZE))
    for sensor in SENSORS:
        rendered = view.render(1, sensor)
        seen = rendered.depth_m > 0
        error = np.abs(rendered.depth_m - rendered.hits.depth_m)[seen]
        assert seen.mean() > 0.25, sensor
        assert np.isfinite(rendered.depth_m).all()
        assert np.median(error) < 0.06, sensor


def test_real_objects_have_contrasts_inside_and_light_differs():
    inside, brightness = {}, []
    for style in STYLES:
        spread = []
        for seed in range(6):
            scene = make_scene("table", seed, frames=2, style=style)
            view = SceneView(scene, scene.intrinsics(160, 120))
            rendered = view.render(0, "clean")
            labels = view.labels(rendered.hits)
            grey = rendered.color.mean(axis=-1)
            spread += [grey[labels == k].std() for k in np.unique(labels[labels > 0]) if (labels == k).sum() > 40]
            if style == "real":
                brightness.append(rendered.color.reshape(-1, 3).mean(axis=0))
        inside[style] = np.median(spread)
    assert inside["real"] > 1.15 * inside["plain"]
    assert np.ptp(np.mean(brightness, axis=1)) > 15
    assert np.ptp([red / blue for red, _, blue in brightness]) > 0.1


def test_exposure_changes_a_little_in_a_scene():
    camera = make_scene("table", 4, frames=2, style="real").color_camera
    gains = np.array([camera.gain_at(k) for k in range(200)]).mean(axis=1)
    assert 1.02 < gains.max() / gains.min() < 1.3
    assert np.abs(np.diff(gains)).max() / gains.mean() < 0.02


def test_some_objects_have_the_color_of_their_support():
    """In some scenes an object is hard to tell from its table by color."""
    scenes = [make_scene("table", seed, frames=2, style="real") for seed in range(12)]
    close = []
    for scene in scenes:
        (table,) = (body for body in scene.furniture if body.model.name == "table")
        top = np.array(table.model.parts[0][1].color)
        colors = np.array([body.model.parts[0][1].color for body in scene.objects])
        close.append((np.abs(colors - top).max(axis=1) < 0.08).sum())
    assert 2 <= np.count_nonzero(close) <= 9


def test_an_object_keeps_its_materials_at_later_visits():
    first, second = make_visits("table", 3, 2, frames=2, style="real")
    later = {body.id: body for body in second.objects}
    both = [body for body in first.objects if body.id in later]
    assert len(both) >= 3
    for body in both:
        looks, again = (
            [replace(look, axis=(0.0, 0.0), yaw_rad=0.0) for _, look in one.model.parts]
            for one in (body, later[body.id])
        )
        assert looks == again
    assert first.light != second.light


def test_the_users_meshes_keep_their_color():
    material = Material((0.2, 0.4, 0.6), (0.1, 0.2, 0.3), Texture.MARBLE, 0.03, 0.2)
    mine = Model("mine", ((box((0.1, 0.1, 0.1)), material),))
    scene = make_scene("table", 1, frames=2, meshes=[mine], style="real")
    looks = [look for body in scene.objects if body.model.name == "mine" for _, look in body.model.parts]
    assert looks == [material]


def test_an_unknown_style_is_told():
    for make in (make_scene, lambda *words, **options: make_visits(*words, 2, **options)):
        with pytest.raises(InputError, match="no style is called 'baroque'; there are plain, real"):
            make("table", 1, frames=2, style="baroque")
