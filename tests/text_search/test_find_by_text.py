"""Objects of results found by a text: cut from their views, embedded, kept beside the results, ranked."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("tokenizers")

from cuboid import open_results
from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.folder import EMBEDDINGS
from cuboid.method.shapes.views import view_of
from cuboid.method.text_search import Embeddings, TextModel
from cuboid.method.text_search.pictures import object_pixels, pictures_of
from made_scenes import CAMERA, cast
from made_shapes import BOXES, TABLE, finished, frames
from made_text_models import made_text_model


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A green box, 1, and a red one, 2."""
    place = tmp_path_factory.mktemp("found")
    return finished(place / "results", place / "recording")


def labels(found: list) -> list[int]:
    return [item.label for item, _ in found]


def test_objects_are_ranked_by_a_text(results: Path, model: Path) -> None:
    opened = open_results(results)
    red, green = opened.find("red mug", model), opened.find("green", model)
    assert labels(red) == [2, 1]
    assert labels(green) == [1, 2]
    assert all(-1.0 <= score <= 1.0 for _, score in (*red, *green))
    assert red[0].score > 0.5 > red[1].score
    assert not (results / EMBEDDINGS).exists()  # to ask writes nothing


def test_vectors_are_kept_and_need_the_recording_no_more(results: Path, model: Path, tmp_path: Path) -> None:
    kept = Path(shutil.copytree(results, tmp_path / "kept"))
    found = open_results(kept).embed(model)
    again = open_results(kept, tmp_path / "no recording")
    assert labels(again.find("red", model)) == [2, 1]
    read = Embeddings.read(kept / EMBEDDINGS)
    assert read.model == found.model == TextModel(model).identity
    for label, vector in found.vectors.items():
        np.testing.assert_allclose(read.vectors[label], vector, atol=1e-3)
    before = (kept / EMBEDDINGS).read_bytes()
    open_results(kept).embed(model)
    assert (kept / EMBEDDINGS).read_bytes() == before

    other = made_text_model(tmp_path / "other", image_output="else")  # its vectors are others: they are made anew
    with pytest.raises(InputError, match="no recording"):
        again.find("red", other)


def test_views_that_were_kept_do_without_a_recording(model: Path, tmp_path: Path) -> None:
    folder = finished(tmp_path / "results", tmp_path / "recording", keep_views=True)
    shutil.rmtree(tmp_path / "recording")
    assert labels(open_results(folder).find("green", model)) == [1, 2]


def test_damaged_vectors_are_refused_in_a_line(results: Path, model: Path, tmp_path: Path) -> None:
    kept = Path(shutil.copytree(results, tmp_path / "kept"))
    open_results(kept).embed(model)
    good = (kept / EMBEDDINGS).read_bytes()
    for content in (b"", good[: len(good) // 2], b"PK\x03\x04" + good[:20]):
        (kept / EMBEDDINGS).write_bytes(content)
        with pytest.raises(InputError, match=r"embeddings\.npz: expected vectors of objects") as error:
            open_results(kept).find("red", model)
        assert "\n" not in str(error.value)
    np.savez(kept / EMBEDDINGS, model=np.array("x"), labels=np.array([1]), vectors=np.full((1, 3), np.nan))
    with pytest.raises(InputError, match="non-finite numbers"):
        open_results(kept).find("red", model)


def test_two_files_of_two_models_are_refused(results: Path, tmp_path: Path) -> None:
    wide = made_text_model(tmp_path / "wide", width=5)
    with pytest.raises(InputError, match="of pictures have 3 numbers, that of the text 5"):
        open_results(results).find("red", wide)


def test_the_mask_is_the_object_alone() -> None:
    """Against the ray cast: of a box before another one, what is of the table or of the other box is left out."""
    grey = np.full(3, 128, np.uint8)
    for frame in frames()[::4]:
        assert frame.T_world_camera is not None
        _, hit = cast([TABLE, *BOXES.values()], frame.T_world_camera)
        for label, box in BOXES.items():
            view = view_of(frame, CAMERA, frame.T_world_camera, box)
            assert view is not None
            x0, y0 = round(CAMERA.cx - view.camera.cx), round(CAMERA.cy - view.camera.cy)
            height, width = view.depth_m.shape
            true = hit[y0 : y0 + height, x0 : x0 + width] == label
            own = object_pixels(view, box)
            assert (own & true).sum() > 0.93 * true.sum()  # its foot is left out
            assert (own & ~true).sum() < 0.07 * own.sum()
            whole, masked = pictures_of(view, box, grey)
            assert whole.shape[0] == whole.shape[1] == max(height, width)
            assert masked.shape[0] == masked.shape[1] <= whole.shape[0]


def test_what_depth_does_not_read_is_pictured_as_it_is() -> None:
    """A dark thing has no readings: its outline alone is the mask."""
    frame = frames()[3]
    assert frame.T_world_camera is not None
    view = view_of(frame, CAMERA, frame.T_world_camera, BOXES[1])
    assert view is not None
    view.depth_m[:] = 0.0
    own = object_pixels(view, BOXES[1])
    assert 0.4 < own.mean() < 1.0
