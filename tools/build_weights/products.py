"""Products of activations, which are rounded to 8 bits while the network runs, with int8 matrices.

A CPU without VNNI adds two neighbouring products in 16 bits, and an overflow gives a wrong value
without an error. The scales of this module keep each of these sums in 16 bits, whatever the
activations are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from onnx import helper

Array = np.ndarray[Any, Any]

PAIR_LIMIT = 128
"""Largest sum of two weights of the same sign among four neighbours in a column: 255 * 128 is below
2**15.
"""
_NEIGHBOURS = 4


def product_scales(matrix: Array) -> Array:
    """Return the int8 scales (N,) of the columns of a matrix (K, N), so that the columns keep to
    ``PAIR_LIMIT``.
    """
    missing = -len(matrix) % _NEIGHBOURS
    padded = np.concatenate([matrix, np.zeros((missing, matrix.shape[1]), matrix.dtype)])
    groups = np.sort(padded.reshape(-1, _NEIGHBOURS, matrix.shape[1]), axis=1)
    positive = np.maximum(groups[:, -2:], 0).sum(axis=1).max(axis=0)
    negative = np.maximum(-groups[:, :2], 0).sum(axis=1).max(axis=0)
    # Each of the two is rounded by half a unit at most.
    by_pair = np.maximum(positive, negative) / (PAIR_LIMIT - 1)
    by_value = np.abs(matrix).max(axis=0) / 127
    scales: Array = np.maximum(np.maximum(by_pair, by_value), 1e-12).astype(np.float32)
    return scales


def factor_matrices(model: onnx.ModelProto) -> set[str]:
    """Return the names of the weights that are the second factor of a matrix product."""
    weights = {tensor.name for tensor in model.graph.initializer if len(tensor.dims) == 2}
    return {
        node.input[1]
        for node in model.graph.node
        if node.op_type == "MatMul" and node.input[1] in weights
    }


def multiply_in_int8(model: onnx.ModelProto) -> onnx.ModelProto:
    """Return a copy of a stored model in which products with int8 matrices are integer products,
    with their biases.
    """
    changed = onnx.ModelProto()
    changed.CopyFrom(model)
    graph = changed.graph
    weights = {tensor.name: tensor for tensor in graph.initializer}
    users: dict[str, list[onnx.NodeProto]] = {}
    for node in graph.node:
        for name in node.input:
            users.setdefault(name, []).append(node)
    nodes = []
    dropped = set()
    for node in graph.node:
        if node.op_type != "MatMul" or f"{node.input[1]}.q8" not in weights:
            nodes.append(node)
            continue
        factor, matrix = node.input
        inputs = [factor, f"{matrix}.q8", f"{matrix}.s"]
        output = node.output[0]
        (follower, *others) = users[output]
        bias = _bias_of(follower, output, weights) if not others else None
        if bias is not None:
            inputs += ["", bias]
            output = follower.output[0]
            dropped.add(output)
        nodes.append(
            helper.make_node("DynamicQuantizeMatMul", inputs, [output], domain="com.microsoft")
        )
        dropped.update(node.output)
    # A product that took its bias along has the output of the addition, which falls away with the
    # unused casts.
    kept = [
        n
        for n in nodes
        if n.op_type == "DynamicQuantizeMatMul" or not dropped.intersection(n.output)
    ]
    del graph.node[:]
    graph.node.extend(_used(kept, {output.name for output in graph.output}))
    needed = {name for node in graph.node for name in node.input}
    unused = [tensor for tensor in graph.initializer if tensor.name not in needed]
    for tensor in unused:
        graph.initializer.remove(tensor)
    if all(entry.domain != "com.microsoft" for entry in changed.opset_import):
        changed.opset_import.append(helper.make_opsetid("com.microsoft", 1))
    return changed


def _bias_of(
    node: onnx.NodeProto, product: str, weights: dict[str, onnx.TensorProto]
) -> str | None:
    """Return the name of the vector that a node adds to a product, or None if it does something
    else.
    """
    if node.op_type != "Add":
        return None
    (term,) = [name for name in node.input if name != product] or [product]
    stored = weights.get(f"{term}.h", weights.get(term))
    return term if stored is not None and len(stored.dims) == 1 else None


def _used(nodes: list[onnx.NodeProto], outputs: set[str]) -> list[onnx.NodeProto]:
    """Return the nodes, in order, that the outputs of the graph depend on."""
    needed = set(outputs)
    kept = []
    for node in reversed(nodes):
        if needed.intersection(node.output):
            kept.append(node)
            needed.update(node.input)
    return kept[::-1]
