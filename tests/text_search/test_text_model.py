"""An image-text model of two ONNX files: what is recognised, what is refused, and what its vectors say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("tokenizers")

from cuboid.ground.core.errors import InputError
from cuboid.method.text_search import MODEL_VARIABLE, TextModel, open_text_model
from made_models import made_model
from made_text_models import PREPROCESSOR, SIDE, made_text_model

RED = np.full((50, 50, 3), (220, 20, 20), np.uint8)
GREEN = np.full((50, 50, 3), (20, 220, 20), np.uint8)


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"image_output": "pooler_output", "text_output": "pooler_output", "mask": False, "length": 8},  # as SigLIP
        {"image_output": "any", "text_output": "any", "preprocessor": None},
        {"preprocessor": {**PREPROCESSOR, "do_center_crop": False, "size": SIDE}, "side": "side"},
        {"preprocessor": {**PREPROCESSOR, "crop_size": None, "size": {"height": SIDE, "width": SIDE}}},
    ],
)
def test_pictures_are_nearest_to_the_text_that_fits_them(tmp_path: Path, form: dict) -> None:
    model = TextModel(made_text_model(tmp_path / "model", **form))
    pictures = model.embed_pictures([RED, GREEN])
    assert pictures.shape == (2, 3)
    np.testing.assert_allclose(np.linalg.norm(pictures, axis=1), 1.0, atol=1e-6)
    for text, best in (("a red mug", 0), ("Green", 1)):
        query = model.query(text)
        assert query.model == model.identity
        assert int((pictures @ query.vector).argmax()) == best


def test_padding_changes_nothing_that_a_mask_tells_apart(tmp_path: Path) -> None:
    """A text longer than the model's length is cut, and not refused."""
    long, short = (TextModel(made_text_model(tmp_path / str(n), length=n)) for n in (8, 3))
    np.testing.assert_allclose(long.query("red mug").vector, short.query("red mug").vector)
    np.testing.assert_allclose(short.query("red a a green").vector, long.query("red").vector)


def test_folders_as_they_are_published_are_found(tmp_path: Path) -> None:
    made = made_text_model(tmp_path / "model")
    (made / "onnx").mkdir()
    (made / "image.onnx").rename(made / "onnx" / "vision_model.onnx")
    (made / "text.onnx").rename(made / "onnx" / "text_model.onnx")
    model = TextModel(made)
    assert float(model.embed_pictures([RED])[0] @ model.query("red").vector) > 0.9


def test_levels_are_normalised_as_the_file_says(tmp_path: Path) -> None:
    model = TextModel(made_text_model(tmp_path / "model"))
    assert (model.preparation.background == 128).all()
    pixels = model.preparation.prepare(np.full((64, 64, 3), (255, 0, 51), np.uint8), np.float32)
    assert pixels.shape == (1, 3, SIDE, SIDE)
    np.testing.assert_allclose(pixels[0, :, 5, 5], (1.0, -1.0, -0.6), atol=1e-6)
    bare = TextModel(made_text_model(tmp_path / "bare", preprocessor=None))
    np.testing.assert_array_equal(bare.preparation.background, (123, 117, 104))  # CLIP's


def test_the_folder_comes_from_the_environment_unless_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(MODEL_VARIABLE, raising=False)
    with pytest.raises(InputError, match="name its folder, or set CUBOID_TEXT_MODEL"):
        open_text_model(None)
    made = made_text_model(tmp_path / "model")
    monkeypatch.setenv(MODEL_VARIABLE, str(made))
    assert open_text_model(None).folder == made
    with pytest.raises(InputError, match=r"expected a folder with image\.onnx"):
        open_text_model(tmp_path / "nowhere")


def both(model: Path) -> None:
    opened = TextModel(model)
    opened.embed_pictures([RED])
    opened.query("red")


def refused(model: Path) -> str:
    with pytest.raises(InputError) as error:
        both(model)
    line = str(error.value)
    assert "\n" not in line
    return line


def test_what_does_not_fit_is_refused_with_what_was_seen(tmp_path: Path) -> None:
    model = made_text_model(tmp_path / "a")
    (model / "text.onnx").unlink()
    assert "expected text.onnx or text_model.onnx or onnx/text_model.onnx" in refused(model)

    model = made_text_model(tmp_path / "b")
    (model / "image.onnx").write_bytes(b"nonsense")
    assert "is no ONNX model that can be run" in refused(model)

    model = made_text_model(tmp_path / "c")  # a detector
    made_model(model / "image.onnx", np.zeros((1, 10, 6), np.float32), side=SIDE)
    assert "expected an output image_embeds or pooler_output (1, n); its outputs are output0 (1, 10, 6)" in refused(
        model
    )

    model = made_text_model(tmp_path / "d")
    (model / "image.onnx").replace(model / "text.onnx")
    made_text_model(tmp_path / "e")
    (tmp_path / "e" / "image.onnx").replace(model / "image.onnx")
    assert "expected a model with an input input_ids (1, length); its inputs are pixel_values" in refused(model)

    model = made_text_model(tmp_path / "f")
    (model / "tokenizer.json").unlink()
    assert "has no tokenizer.json" in refused(model)
    (model / "tokenizer.json").write_text("{}")
    assert "is no tokenizer" in refused(model)

    model = made_text_model(tmp_path / "g", preprocessor={**PREPROCESSOR, "crop_size": {"height": 64, "width": 64}})
    assert "images of 64 x 64 pixels, but the model needs 32 x 32" in refused(model)
    (model / "preprocessor_config.json").write_text(json.dumps({**PREPROCESSOR, "crop_size": {"longest": 3}}))
    assert "size: expected a number of pixels" in refused(model)
    (model / "preprocessor_config.json").write_text(json.dumps({**PREPROCESSOR, "image_std": [0.5, 0.0, 0.5]}))
    assert "image_std" in refused(model)

    with pytest.raises(InputError, match="got an empty text"):
        TextModel(made_text_model(tmp_path / "h")).query("  ")
    assert "expected an output vector of finite length above 0" in refused_text(tmp_path / "h", "a a")


def refused_text(model: Path, text: str) -> str:
    with pytest.raises(InputError) as error:
        TextModel(model).query(text)
    return str(error.value)
