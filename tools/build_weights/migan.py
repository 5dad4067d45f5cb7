"""MI-GAN: the generator of the published pipeline, without operators that only cost time.

The pipeline also finds the hole, crops, resizes and blends, all of it on the full photo and in
operators that are slow there. The generator doubles the size of a map by zeros between its values
and a convolution, which is a transposed convolution with a third of the memory. It multiplies each
activation by a gain, which is folded into the weights, and clamps it to +-256, which is skipped:
over holes in 19 photos the largest activation was 74.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

CLAMP = 256.0

Ends = dict[str, tuple[str, tuple[int, ...]]]
"""Name of a tensor of the graph -> its new name and shape."""


def cut(model: onnx.ModelProto, inputs: Ends, outputs: Ends) -> None:
    """Reduce a graph, in place, to what computes some of its float32 tensors from others."""
    graph = model.graph
    names = {old: new for old, (new, _) in (inputs | outputs).items()}
    for node in graph.node:
        node.input[:] = [names.get(name, name) for name in node.input]
        # The nodes that made an input are not used any more.
        node.output[:] = [name if name in inputs else names.get(name, name) for name in node.output]
    _drop_unused(model, {name for name, _ in outputs.values()})
    del graph.value_info[:]
    for ends, values in ((inputs, graph.input), (outputs, graph.output)):
        del values[:]
        values.extend(
            helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
            for name, shape in ends.values()
        )


def fold_gains(model: onnx.ModelProto) -> int:
    """Fold the gain behind each leaky ReLU into the weights before it, and drop the clamps; return
    how many.

    A leaky ReLU of a scaled value is the scaled leaky ReLU, if the scale is positive.
    """
    graph = model.graph
    maker = {name: node for node in graph.node for name in node.output}
    users: dict[str, list[onnx.NodeProto]] = {}
    for node in graph.node:
        for name in node.input:
            users.setdefault(name, []).append(node)
    weights = {tensor.name: tensor for tensor in graph.initializer}
    scaled: dict[str, float] = {}
    renamed: dict[str, str] = {}
    for activation in [node for node in graph.node if node.op_type == "LeakyRelu"]:
        (gain_node,) = users[activation.output[0]]
        (clamp,) = users[gain_node.output[0]]
        if (gain_node.op_type, clamp.op_type) != ("Mul", "Clip"):
            raise ValueError(
                f"{activation.name} is followed by {gain_node.op_type} and {clamp.op_type}"
            )
        gain = float(_constant(gain_node.input[1], maker, weights))
        limits = [float(_constant(name, maker, weights)) for name in clamp.input[1:]]
        if gain <= 0 or limits != [-CLAMP, CLAMP]:
            raise ValueError(f"{activation.name} has gain {gain} and limits {limits}")
        for name in _linear_weights(activation.input[0], maker, weights):
            if len(users[name]) > 1 or name in scaled:
                raise ValueError(f"{name} is used more than once")
            scaled[name] = gain
        renamed[clamp.output[0]] = activation.output[0]
    for name, gain in scaled.items():
        value = numpy_helper.to_array(weights[name]) * np.float32(gain)
        weights[name].CopyFrom(numpy_helper.from_array(value, name))
    dropped = {name for clamp in renamed for name in (clamp, maker[clamp].input[0])}
    kept = [node for node in graph.node if not dropped.intersection(node.output)]
    for node in kept:
        node.input[:] = [renamed.get(name, name) for name in node.input]
    del graph.node[:]
    graph.node.extend(kept)
    return len(renamed)


def transpose_upsampling(model: onnx.ModelProto) -> int:
    """Replace each upsampling by a transposed convolution with the same weights, in place; return
    how many.

    Its zeros come from a product with a map of ones and zeros, and its filter is symmetric.
    """
    graph = model.graph
    maker = {name: node for node in graph.node for name in node.output}
    replaced = 0
    for node in graph.node:
        if node.op_type != "Conv" or not node.name.endswith("/upsample/filter/Conv"):
            continue
        pad = maker[node.input[0]]
        product = maker[pad.input[0]]
        repeat = maker[product.input[0]]
        if (pad.op_type, product.op_type, repeat.op_type) != ("Pad", "Mul", "Resize"):
            raise ValueError(
                f"{node.name} follows {repeat.op_type}, {product.op_type} and {pad.op_type}"
            )
        group = next(attribute.i for attribute in node.attribute if attribute.name == "group")
        node.CopyFrom(
            helper.make_node(
                "ConvTranspose",
                [repeat.input[0], node.input[1]],
                node.output,
                name=node.name,
                group=group,
                strides=[2, 2],
                pads=[1, 1, 1, 1],
            )
        )
        replaced += 1
    _drop_unused(model, {output.name for output in graph.output})
    return replaced


def _drop_unused(model: onnx.ModelProto, outputs: set[str]) -> None:
    """Keep only the nodes and weights that the outputs depend on."""
    graph = model.graph
    needed = set(outputs)
    kept = []
    for node in reversed(graph.node):
        if needed.intersection(node.output):
            kept.append(node)
            needed.update(node.input)
    del graph.node[:]
    graph.node.extend(kept[::-1])
    for tensor in [tensor for tensor in graph.initializer if tensor.name not in needed]:
        graph.initializer.remove(tensor)


def _constant(
    name: str, maker: dict[str, onnx.NodeProto], weights: dict[str, onnx.TensorProto]
) -> Any:
    return numpy_helper.to_array(weights[name] if name in weights else maker[name].attribute[0].t)


def _linear_weights(
    name: str, maker: dict[str, onnx.NodeProto], weights: dict[str, onnx.TensorProto]
) -> list[str]:
    """Return the weights to scale, so that a value that depends on them linearly is scaled."""
    node = maker[name]
    if node.op_type == "Add":
        noise = next(term for term in node.input if term in weights)
        value = next(term for term in node.input if term not in weights)
        return [noise, *_linear_weights(value, maker, weights)]
    if node.op_type == "Conv" and "upsample" not in node.name:
        return list(node.input[1:])
    return _linear_weights(node.input[0], maker, weights)
