"""Tiny ONNX models with the inputs and outputs of real ones, which answer what they are told to, whatever they see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

# The side of the input of the models, pixels: an image of 640 x 480 lies in it at half size, 40 rows from the top.
SIDE = 320
KINDS = {np.dtype(np.float32): TensorProto.FLOAT, np.dtype(np.int64): TensorProto.INT64}


def made_model(
    path: Path,
    *outputs: NDArray[np.generic],
    side: int | str = SIDE,
    kind: int = TensorProto.FLOAT,
    names: Sequence[str] = (),
    others: Mapping[str, tuple[int, tuple[int | str, ...]]] | None = None,
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """Write a model whose outputs are given, plus the same tiny share of its inputs.

    `names` are those of the outputs, `others` the inputs beside the image: type and shape by name.
    """
    infos = {"images": (kind, (1, 3, side, side)), **(others or {})}
    inputs = [helper.make_tensor_value_info(name, of, list(shape)) for name, (of, shape) in infos.items()]
    values = [numpy_helper.from_array(np.zeros((), np.float32), "zero")]
    nodes = []
    for name in infos:
        nodes += [
            helper.make_node("Cast", [name], [f"{name} real"], to=TensorProto.FLOAT),
            helper.make_node("ReduceMax", [f"{name} real"], [f"{name} most"], keepdims=0),
            helper.make_node("Mul", [f"{name} most", "zero"], [f"{name} nothing"]),
        ]
    nodes.append(helper.make_node("Sum", [f"{name} nothing" for name in infos], ["nothing"]))
    found = []
    for k, output in enumerate(outputs):
        name, of = (names[k] if names else f"output{k}"), KINDS[output.dtype]
        values.append(numpy_helper.from_array(output, f"known{k}"))
        nodes += [
            helper.make_node("Cast", ["nothing"], [f"nothing{k}"], to=of),
            helper.make_node("Add", [f"known{k}", f"nothing{k}"], [name]),
        ]
        found.append(helper.make_tensor_value_info(name, of, list(output.shape)))
    graph = helper.make_graph(nodes, "known", inputs, found, values)
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    helper.set_model_props(made, dict(metadata or {}))
    onnx.save(made, str(path))
    return path
