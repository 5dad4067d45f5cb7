"""Storing the weights of an ONNX model in fewer bits.

A float32 weight becomes float16 with a Cast, or int8 per output channel with a Cast and a Mul.
onnxruntime folds both when it loads the model, so the arithmetic stays float32; only what lies on
the disk is smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnx.external_data_helper import set_external_data

from tools.build_weights.products import product_scales

Axis = Callable[[str, np.ndarray[Any, Any]], int | None]
"""Name and value of a weight -> the axis of its output channels, or None for float16."""


def store(
    model: onnx.ModelProto,
    axis_of: Axis | None = None,
    smallest: int = 64,
    smallest_int8: int = 4096,
    products: Collection[str] = (),
) -> int:
    """Rewrite the float weights of a model in place; return how many.

    Args:
        model: to be rewritten.
        axis_of: which weights become int8 and along which axis their scales run; None for float16
            throughout.
        products: matrices (K, N) that become int8 for integer products, see
            :mod:`tools.build_weights.products`.
        smallest: weights with fewer values stay as they are.
        smallest_int8: weights with fewer values never become int8.
    """
    graph = model.graph
    nodes = []
    weights = []
    for tensor in list(graph.initializer):
        if tensor.data_type not in (TensorProto.FLOAT, TensorProto.FLOAT16):
            continue
        value = numpy_helper.to_array(tensor)
        if value.size < smallest:
            continue
        graph.initializer.remove(tensor)
        name = tensor.name
        exact = value.astype(np.float32)
        axis = (
            axis_of(name, value)
            if axis_of and value.ndim >= 2 and value.size >= smallest_int8
            else None
        )
        if name in products:
            nodes += _stored_in_int8(name, exact, product_scales(exact), weights)
        elif axis is None:
            if np.abs(exact).max() >= 65000:
                raise ValueError(
                    f"weight {name} reaches {np.abs(exact).max()}, which float16 cannot hold"
                )
            weights.append(numpy_helper.from_array(exact.astype(np.float16), f"{name}.h"))
            nodes.append(helper.make_node("Cast", [f"{name}.h"], [name], to=TensorProto.FLOAT))
        else:
            nodes += _stored_in_int8(name, exact, _scales(exact, axis), weights)
    count = sum(n.op_type == "Cast" for n in nodes)
    graph.initializer.extend(weights)
    rest = list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes + rest)
    return count


def _stored_in_int8(
    name: str,
    value: np.ndarray[Any, Any],
    scale: np.ndarray[Any, Any],
    weights: list[onnx.TensorProto],
) -> list[onnx.NodeProto]:
    """Append a weight in int8 and its scale to ``weights``; return the nodes that make float32 of
    them.
    """
    rounded = np.clip(np.rint(value / scale), -127, 127).astype(np.int8)
    weights.append(numpy_helper.from_array(rounded, f"{name}.q8"))
    weights.append(numpy_helper.from_array(scale, f"{name}.s"))
    return [
        helper.make_node("Cast", [f"{name}.q8"], [f"{name}.c"], to=TensorProto.FLOAT),
        helper.make_node("Mul", [f"{name}.c", f"{name}.s"], [name]),
    ]


def _scales(value: np.ndarray[Any, Any], axis: int) -> np.ndarray[Any, Any]:
    """int8 scales per channel, of a few that clip more or less the one with the least squared
    error.
    """
    others = tuple(i for i in range(value.ndim) if i != axis)
    full = np.abs(value).max(others, keepdims=True) / 127
    best = None
    least = None
    for shrink in (1, 0.97, 0.94, 0.9, 0.85, 0.8):
        scale = np.maximum(full * shrink, 1e-12)
        rounded = np.clip(np.rint(value / scale), -127, 127)
        error = ((rounded * scale - value) ** 2).sum(others, keepdims=True)
        if best is None or least is None:
            best = scale
            least = error
        else:
            better = error < least
            best = np.where(better, scale, best)
            least = np.where(better, error, least)
    assert best is not None
    return best.astype(np.float32)


def output_channel_axes(model: onnx.ModelProto) -> dict[str, int]:
    """Axis of the output channels of each weight that a convolution or a matrix product takes."""
    axes: dict[str, int] = {}
    for node in model.graph.node:
        if node.op_type == "Conv":
            axes[node.input[1]] = 0
        elif node.op_type in ("ConvTranspose", "MatMul"):
            axes[node.input[1]] = 1
        elif node.op_type == "Gemm":
            axes[node.input[1]] = (
                0 if any(a.name == "transB" and a.i for a in node.attribute) else 1
            )
    return axes


def save(model: onnx.ModelProto, source: str, licence: str) -> bytes:
    """Check a model and serialise it with its origin."""
    for key, value in (("source", source), ("license", licence)):
        entry = model.metadata_props.add()
        entry.key = key
        entry.value = value
    model.producer_name = "embedded-weights-build"
    if not any(
        tensor.HasField("data_location") and tensor.external_data
        for tensor in model.graph.initializer
    ):
        onnx.checker.check_model(model)  # the checker looks for external weights on the disk
    data: bytes = model.SerializeToString()
    return data


def save_together(
    models: dict[str, onnx.ModelProto], weights: str, source: str, licence: str
) -> dict[str, bytes]:
    """Serialise graphs of one network, whose weights of 1 KB and more are in one further file.

    Args:
        models: name of the file -> graph. Weights of one name are the same in all of them.
        weights: name of the file of the weights.

    Returns:
        Name -> content, of all files.
    """
    content = bytearray()
    places: dict[str, tuple[int, int]] = {}
    files = {}
    for file, model in models.items():
        for tensor in model.graph.initializer:
            value = numpy_helper.to_array(tensor).tobytes()
            if len(value) < 1024:
                continue
            if tensor.name not in places:
                content += bytes(-len(content) % 64)
                places[tensor.name] = len(content), len(value)
                content += value
            start, length = places[tensor.name]
            assert bytes(content[start : start + length]) == value, tensor.name
            tensor.raw_data = value
            set_external_data(tensor, weights, offset=start, length=length)
            tensor.ClearField("raw_data")
        files[file] = save(model, source, licence)
    return {**files, weights: bytes(content)}
