from __future__ import annotations

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.lab.synthetic import make_scene
from cuboid.lab.synthetic.light import ColorCamera, Lamp, Light
from cuboid.lab.synthetic.material import Layer, Material, Texture, Zone
from cuboid.lab.synthetic.mesh import box, corner_normals
from cuboid.lab.synthetic.paths import look_at
from cuboid.lab.synthetic.raycast import RayCaster, pixel_rays
from cuboid.lab.synthetic.shading import ShadingParameters, _places, part_rows, shade
from cuboid.lab.synthetic.view import SceneView

CAMERA = Intrinsics(80.0, 80.0, 31.5, 23.5, 64, 48)
T = look_at((0, -1.2, 1.0), (0, 0, 0))


def cast(meshes, materials, lamp=(0.5, -1.0, 2.0)):
    corners = np.concatenate([mesh.corners() for mesh in meshes])
    caster = RayCaster(corners)
    parts, layers = part_rows(materials, [np.eye(4)] * len(meshes))
    look = ShadingParameters(
        face_part=np.repeat(np.arange(len(meshes), dtype=np.int32), [len(mesh.faces) for mesh in meshes]),
        normals=np.concatenate([corner_normals(mesh) for mesh in meshes]).astype(np.float32),
        parts=parts,
        layers=layers,
        light=Light((Lamp(np.array([lamp])),)),
    )
    hits = caster.first_hits(T[:3, 3].astype(np.float32), pixel_rays(CAMERA, T))
    shaded = shade(caster, look, hits, np.random.default_rng(0), ColorCamera(), 0)
    return look, hits, shaded.color.astype(int), shaded.cosine


def test_depth_is_that_of_the_plane():
    _, hits, _, cosine = cast([box((40, 40, 1), (0, 0, -1))], [Material((0.5, 0.5, 0.5))])
    rays = pixel_rays(CAMERA, T).astype(np.float64)
    expected = -T[2, 3] / rays[..., 2]
    down = rays[..., 2] < -0.1
    np.testing.assert_allclose(hits.depth_m[down], expected[down], rtol=1e-5)
    np.testing.assert_allclose(cosine[down], (-rays[..., 2] / np.linalg.norm(rays, axis=2))[down], atol=1e-5)


def test_a_body_throws_a_shadow_and_its_colors_are_its_own():
    floor, red = Material((0.7, 0.7, 0.7)), Material((0.8, 0.1, 0.1))
    bare = cast([box((8, 8, 1), (0, 0, -1))], [floor])[2]
    look, hits, color, _ = cast([box((8, 8, 1), (0, 0, -1)), box((0.3, 0.3, 0.3))], [floor, red], (1.2, 0, 1.2))
    part = np.where(hits.face >= 0, look.face_part[hits.face], -1)
    body = color[part == 1]
    assert (body[:, 0] > body[:, 1] + 30).mean() > 0.95
    left = color[24, :20].mean()
    shaded = color[26, 14:24].min(axis=0).mean()
    assert shaded < 0.8 * left
    assert bare[26, 14:24].min() > 0.9 * bare[26, 14:24].max()


def test_textures_have_both_colors():
    for texture in Texture:
        if texture != Texture.PLAIN:
            look = Material((0.9, 0.1, 0.1), (0.1, 0.1, 0.9), texture, 0.2)
            _, hits, color, _ = cast([box((8, 8, 1), (0, 0, -1))], [look])
            seen = color[hits.face >= 0]
            redness = (seen[:, 0] - seen[:, 2]) / seen.sum(axis=1)
            assert np.ptp(np.percentile(redness, [5, 95])) > 0.15, texture.name


def test_a_layer_covers_its_zone_alone():
    """The box has a red body, a blue band at its upper half and a green sheet on its top."""
    blue, green = (0.1, 0.1, 0.9), (0.1, 0.9, 0.1)
    band = Layer(blue, blue, zone=Zone.BAND, extent=(0.25, 1, 0, 0))
    sheet = Layer(green, green, zone=Zone.SHEET, extent=(0, 0, 0.1, 0.1))
    look = Material((0.9, 0.1, 0.1), (0.9, 0.1, 0.1), layers=(band, sheet))
    _, hits, color, _ = cast([box((0.5, 0.5, 0.5))], [look])
    x, _, z = np.moveaxis(hits.eye + hits.rays * hits.depth_m[..., None], -1, 0)
    side = (hits.face >= 0) & (z < 0.47)
    strongest = color.argmax(axis=-1)
    assert (strongest[side & (z < 0.22)] == 0).all()
    assert (strongest[side & (z > 0.28)] == 2).all()
    top = (hits.face >= 0) & (z > 0.499)
    assert (strongest[top & (abs(x) > 0.14)] == 2).all()
    assert (strongest[top] == 1).any()


def test_kernel_of_places_equals_its_plain_form():
    scene = make_scene("table", 2, frames=1)
    intrinsics = scene.intrinsics(64, 48)
    view = SceneView(scene, intrinsics)
    hits, table = view.render(0, "clean").hits, view._look.normals
    points, normals = np.empty((2, 48, 64, 3), np.float32)
    cosine = np.empty((48, 64), np.float32)
    _places(hits.depth_m, hits.face, hits.u, hits.v, hits.rays, hits.eye, table, points, normals, cosine)
    np.testing.assert_allclose(points, hits.eye + hits.rays * hits.depth_m[..., None], atol=1e-5)
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=-1)
    expected = np.einsum("hwk,hwkj->hwj", weights, table[hits.face])
    expected /= np.linalg.norm(expected, axis=2, keepdims=True)
    along = np.einsum("hwj,hwj->hw", expected, hits.rays) / np.linalg.norm(hits.rays, axis=2)
    seen = hits.face >= 0
    np.testing.assert_allclose(normals[seen], (expected * -np.sign(along)[..., None])[seen], atol=1e-4)
    np.testing.assert_allclose(cosine[seen], np.abs(along)[seen], atol=1e-4)
