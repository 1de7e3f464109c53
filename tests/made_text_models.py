"""A tiny image-text model with the inputs and outputs of real ones: it knows colors, and words for them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIDE = 32
WORDS = {
    "red": (1.0, -0.5, -0.5),
    "green": (-0.5, 1.0, -0.5),
    "blue": (-0.5, -0.5, 1.0),
    "a": (0.0, 0.0, 0.0),
    "mug": (0.1, 0.1, 0.1),
}
UNKNOWN, PADDING = "[UNK]", "[PAD]"
# Beside the files of the model itself.
PREPROCESSOR: dict[str, Any] = {
    "do_center_crop": True,
    "crop_size": {"height": SIDE, "width": SIDE},
    "size": {"shortest_edge": SIDE},
    "image_mean": [0.5, 0.5, 0.5],
    "image_std": [0.5, 0.5, 0.5],
    "resample": 3,
}


def made_text_model(
    folder: Path,
    *,
    width: int = 3,
    image_output: str = "image_embeds",
    text_output: str = "text_embeds",
    mask: bool = True,
    length: int | str = "length",
    preprocessor: dict[str, Any] | None = PREPROCESSOR,
    side: int | str = SIDE,
) -> Path:
    """Write the folder of a model: the mean color of a picture, and the mean of the colors of a text's words.

    `width` is how many numbers the vector of a text has; that of a picture has three.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _save(folder / "image.onnx", *_image(image_output, side))
    _save(folder / "text.onnx", *_text(text_output, width, mask, length))
    vocabulary = {word: k for k, word in enumerate((PADDING, UNKNOWN, *WORDS))}
    tokenizer = {
        "version": "1.0",
        "truncation": None,
        "padding": None,
        "added_tokens": [],
        "normalizer": {"type": "Lowercase"},
        "pre_tokenizer": {"type": "Whitespace"},
        "post_processor": None,
        "decoder": None,
        "model": {"type": "WordLevel", "vocab": vocabulary, "unk_token": UNKNOWN},
    }
    (folder / "tokenizer.json").write_text(json.dumps(tokenizer))
    (folder / "tokenizer_config.json").write_text(json.dumps({"model_max_length": 8, "pad_token": PADDING}))
    if preprocessor is not None:
        (folder / "preprocessor_config.json").write_text(json.dumps(preprocessor))
    return folder


def _save(path: Path, nodes: list[Any], inputs: list[Any], outputs: list[Any], values: list[Any]) -> None:
    graph = helper.make_graph(nodes, "known", inputs, outputs, values)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))


def _image(output: str, side: int | str) -> tuple[list[Any], list[Any], list[Any], list[Any]]:
    """The mean color, and as many real ones have it, a table of patches beside it."""
    nodes = [
        helper.make_node("ReduceMean", ["pixel_values"], [output], axes=[2, 3], keepdims=0),
        helper.make_node("ReduceMean", ["pixel_values"], ["last_hidden_state"], axes=[3], keepdims=0),
    ]
    image = helper.make_tensor_value_info("pixel_values", TensorProto.FLOAT, ["batch", 3, side, side])
    return nodes, [image], _outputs(output, 3), []


def _text(output: str, width: int, mask: bool, length: int | str) -> tuple[list[Any], list[Any], list[Any], list[Any]]:
    table = np.zeros((2 + len(WORDS), width), np.float32)
    table[2:, :3] = list(WORDS.values())
    table[1, :3] = 0.01  # what it does not know is grey
    values = [numpy_helper.from_array(table, "words")]
    nodes = [helper.make_node("Gather", ["words", "input_ids"], ["last_hidden_state"])]
    names = ["input_ids"]
    if mask:
        names.append("attention_mask")
        values.append(numpy_helper.from_array(np.array([2]), "at"))
        nodes += [
            helper.make_node("Cast", ["attention_mask"], ["counts"], to=TensorProto.FLOAT),
            helper.make_node("Unsqueeze", ["counts", "at"], ["counts of words"]),
            helper.make_node("Mul", ["last_hidden_state", "counts of words"], ["counted"]),
            helper.make_node("ReduceSum", ["counted", "one"], [output], keepdims=0),
        ]
    else:
        nodes.append(helper.make_node("ReduceSum", ["last_hidden_state", "one"], [output], keepdims=0))
    values.append(numpy_helper.from_array(np.array([1]), "one"))
    inputs = [helper.make_tensor_value_info(name, TensorProto.INT64, ["batch", length]) for name in names]
    return nodes, inputs, _outputs(output, width), values


def _outputs(output: str, width: int) -> list[Any]:
    return [
        helper.make_tensor_value_info("last_hidden_state", TensorProto.FLOAT, ["batch", "n", "m"]),
        helper.make_tensor_value_info(output, TensorProto.FLOAT, ["batch", width]),
    ]
