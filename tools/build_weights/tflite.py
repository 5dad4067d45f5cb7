"""TFLite to ONNX, as far as the packaged networks need it: float operators, float16, sparse and
quantised weights.

Inputs and outputs keep the NHWC layout of TFLite, inside feature maps are NCHW. A quantised network
becomes one in float32: its weights are dequantised, and feature maps are not rounded.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from ai_edge_litert import schema_py_generated as schema
from onnx import TensorProto, helper, numpy_helper

Array = np.ndarray[Any, Any]
DTYPES = {
    schema.TensorType.FLOAT32: np.float32,
    schema.TensorType.FLOAT16: np.float16,
    schema.TensorType.INT32: np.int32,
    schema.TensorType.INT64: np.int64,
    schema.TensorType.INT8: np.int8,
    schema.TensorType.UINT8: np.uint8,
}
OPERATORS = {v: k for k, v in vars(schema.BuiltinOperator).items() if isinstance(v, int)}


def dense(tensor: Any, values: Array) -> Array:
    """A sparse TFLite tensor written out: traversal order, optional blocks, dense and compressed
    dimensions.
    """
    sparsity = tensor.sparsity
    shape = [int(v) for v in tensor.shape]
    order = [int(v) for v in sparsity.traversalOrder]
    blocks = [int(v) for v in sparsity.blockMap] if sparsity.blockMap is not None else []
    dims = sparsity.dimMetadata
    rank = len(shape)
    block_size = {d: int(dims[rank + i].denseSize) for i, d in enumerate(blocks)}

    def numbers(vector: Any) -> list[int] | None:
        return [int(v) for v in vector.values] if vector is not None else None

    segments = [numbers(d.arraySegments) for d in dims]
    indices = [numbers(d.arrayIndices) for d in dims]
    out = np.zeros(shape, values.dtype)
    index = [0] * (rank + len(blocks))
    taken = 0

    def visit(level: int, previous: int) -> None:
        nonlocal taken
        if level == len(dims):
            at = [0] * rank
            for i in range(rank):
                at[order[i]] = index[i]
            for i in range(rank, len(dims)):
                d = blocks[order[i] - rank]
                at[d] = at[d] * block_size[d] + index[i]
            out[tuple(at)] = values[taken]
            taken += 1
        elif dims[level].format == schema.DimensionType.DENSE:
            for i in range(dims[level].denseSize):
                index[level] = i
                visit(level + 1, previous * dims[level].denseSize + i)
        else:
            segment = segments[level]
            column = indices[level]
            assert segment is not None
            assert column is not None
            for k in range(segment[previous], segment[previous + 1]):
                index[level] = column[k]
                visit(level + 1, k)

    visit(0, 0)
    if taken != len(values):
        raise ValueError(f"{taken} of {len(values)} values of a sparse tensor have a place")
    return out


def convert(
    flatbuffer: bytes,
    names: dict[str, str],
    graph_name: str,
    opset: int = 17,
    operators: int | None = None,
) -> onnx.ModelProto:
    """A TFLite model as ONNX, its inputs and outputs renamed by ``names``.

    A quantised input keeps its integer values, as float32.

    Args:
        flatbuffer: the file.
        names: of TFLite -> of ONNX.
        graph_name: of the ONNX graph.
        opset: of the ONNX model.
        operators: convert the first ones only (negative: all but the last ones); what the last of
            them returns is the only output, named "output".

    Raises:
        ValueError: an operator or an activation that is not known here.
    """
    return _Converter(flatbuffer, names, operators).model(graph_name, opset)


class _Converter:
    def __init__(
        self, flatbuffer: bytes, names: dict[str, str], operators: int | None = None
    ) -> None:
        self.tflite = schema.ModelT.InitFromObj(schema.Model.GetRootAs(flatbuffer, 0))
        self.graph = self.tflite.subgraphs[0]
        if operators is not None:
            self.graph.operators = self.graph.operators[:operators]
            self.graph.outputs = self.graph.operators[-1].outputs
            self.graph.tensors[self.graph.outputs[0]].name = "output"
        self.names = names
        self.nodes: list[onnx.NodeProto] = []
        self.weights: dict[str, onnx.TensorProto] = {}
        self.values: dict[int, str] = {}
        self.count = 0
        self.constants = {
            i: a for i in range(len(self.graph.tensors)) if (a := self._constant(i)) is not None
        }

    def model(self, graph_name: str, opset: int) -> onnx.ModelProto:
        entry = self.graph.inputs[0]
        entry_name = self._name(entry)
        self.values[entry] = self._real(
            entry, self.add("Transpose", [entry_name], perm=[0, 3, 1, 2])
        )
        for operator in self.graph.operators:
            self._operator(operator)
        outputs = []
        for tensor in self.graph.outputs:
            value = self.values[tensor]
            name = self._name(tensor)
            if len(self.shape(tensor)) == 4:
                self.nodes.append(helper.make_node("Transpose", [value], [name], perm=[0, 2, 3, 1]))
            else:
                self.nodes.append(helper.make_node("Identity", [value], [name]))
            outputs.append(
                helper.make_tensor_value_info(name, TensorProto.FLOAT, self.shape(tensor))
            )
        used = {x for n in self.nodes for x in n.input}
        inputs = [helper.make_tensor_value_info(entry_name, TensorProto.FLOAT, self.shape(entry))]
        weights = [w for name, w in self.weights.items() if name in used]
        graph = helper.make_graph(self.nodes, graph_name, inputs, outputs, weights)
        return helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=9
        )

    def shape(self, tensor: int) -> list[int]:
        return [int(v) for v in self.graph.tensors[tensor].shape]

    def weight(self, value: Array, name: str | None = None) -> str:
        self.count += 1
        name = name or f"c{self.count}"
        self.weights[name] = numpy_helper.from_array(np.ascontiguousarray(value), name)
        return name

    def add(self, operator: str, inputs: list[str], **attributes: Any) -> str:
        self.count += 1
        out = f"t{self.count}"
        self.nodes.append(helper.make_node(operator, inputs, [out], **attributes))
        return out

    def get(self, tensor: int) -> str:
        """Name of a tensor's value, a constant laid out like a feature map where it is one."""
        if tensor not in self.values:
            value = self.constants[tensor].astype(np.float32)
            if value.ndim == 4:
                value = value.transpose(0, 3, 1, 2)
            self.values[tensor] = self.weight(value, f"w{tensor}")
        return self.values[tensor]

    def _name(self, tensor: int) -> str:
        name = self.graph.tensors[tensor].name
        name = name.decode() if isinstance(name, bytes) else name
        return self.names.get(name, name)

    def _constant(self, i: int) -> Array | None:
        tensor = self.graph.tensors[i]
        data = self.tflite.buffers[tensor.buffer].data
        if data is None or len(data) == 0:
            return None
        values = np.frombuffer(np.asarray(data, np.uint8).tobytes(), DTYPES[tensor.type])
        if tensor.sparsity is not None:
            return dense(tensor, values)
        values = values.reshape(
            [int(v) for v in tensor.shape] if tensor.shape is not None else values.shape
        )
        return _dequantised(values, tensor.quantization)

    def _real(self, tensor: int, value: str) -> str:
        """Scale a quantised input to real values; return ``value`` itself if the tensor is not
        quantised.
        """
        quantization = self.graph.tensors[tensor].quantization
        if quantization is None or quantization.scale is None:
            return value
        centred = self.add("Sub", [value, self.weight(np.float32(quantization.zeroPoint[0]))])
        return self.add("Mul", [centred, self.weight(np.float32(quantization.scale[0]))])

    def _activated(self, value: str, kind: int) -> str:
        kinds = schema.ActivationFunctionType
        if kind == kinds.NONE:
            return value
        if kind == kinds.RELU:
            return self.add("Relu", [value])
        if kind == kinds.RELU6:
            return self.add("Clip", [value, self.weight(np.float32(0)), self.weight(np.float32(6))])
        raise ValueError(f"unknown activation {kind}")

    def _rows(self, tensor: int) -> str:
        """A feature map turned back to NHWC, so that flattening it gives TFLite's order."""
        value = self.get(tensor)
        return (
            self.add("Transpose", [value], perm=[0, 2, 3, 1])
            if len(self.shape(tensor)) == 4
            else value
        )

    def _operator(self, operator: Any) -> None:
        code = self.tflite.operatorCodes[operator.opcodeIndex]
        name = OPERATORS[max(code.builtinCode, code.deprecatedBuiltinCode)]
        inputs = [int(v) for v in operator.inputs]
        out = int(operator.outputs[0])
        options = operator.builtinOptions
        if name in ("DEQUANTIZE", "DENSIFY"):
            self.constants[out] = self.constants[inputs[0]]
        elif name == "QUANTIZE":  # to another scale of the same real values
            self.values[out] = self.get(inputs[0])
        elif name == "AVERAGE_POOL_2D":
            if self.shape(out)[1:3] != [1, 1] or options.padding != schema.Padding.VALID:
                raise ValueError("an average over less than the feature map")
            value = self.add("GlobalAveragePool", [self.get(inputs[0])])
            self.values[out] = self._activated(value, options.fusedActivationFunction)
        elif name in ("CONV_2D", "DEPTHWISE_CONV_2D"):
            self.values[out] = self._convolution(name, inputs, options)
        elif name == "ADD":
            value = self.add("Add", [self.get(inputs[0]), self.get(inputs[1])])
            self.values[out] = self._activated(value, options.fusedActivationFunction)
        elif name == "PAD":
            pads = self.constants[inputs[1]][[0, 3, 1, 2]]
            value = self.get(inputs[0])
            ends = self.weight(np.r_[pads[:, 0], pads[:, 1]].astype(np.int64))
            self.values[out] = self.add("Pad", [value, ends])
        elif name == "MAX_POOL_2D":
            stride = (options.strideH, options.strideW)
            kernel = (options.filterHeight, options.filterWidth)
            pads = _same(self.shape(inputs[0])[1:3], kernel, stride, (1, 1), options.padding)
            value = self.add(
                "MaxPool",
                [self.get(inputs[0])],
                kernel_shape=list(kernel),
                strides=list(stride),
                pads=pads,
            )
            self.values[out] = self._activated(value, options.fusedActivationFunction)
        elif name == "RESIZE_BILINEAR":
            n, height, width, channels = self.shape(out)
            corners = options.alignCorners
            half = options.halfPixelCenters
            mode = "align_corners" if corners else ("half_pixel" if half else "asymmetric")
            value = self.get(inputs[0])
            size = self.weight(np.array([n, channels, height, width], np.int64))
            self.values[out] = self.add(
                "Resize", [value, "", "", size], mode="linear", coordinate_transformation_mode=mode
            )
        elif name == "DEPTH_TO_SPACE":
            self.values[out] = self.add(
                "DepthToSpace", [self.get(inputs[0])], blocksize=options.blockSize, mode="DCR"
            )
        elif name == "PRELU":
            slope = self.constants[inputs[1]].astype(np.float32).reshape(-1, 1, 1)
            value = self.get(inputs[0])
            self.values[out] = self.add(
                "PRelu", [value, self.weight(slope, f"a{inputs[1]}_{self.count}")]
            )
        elif name == "LOGISTIC":
            self.values[out] = self.add("Sigmoid", [self.get(inputs[0])])
        elif name == "MEAN":
            if sorted(int(v) for v in self.constants[inputs[1]].ravel()) != [1, 2]:
                raise ValueError("a mean over other axes than rows and columns")
            self.values[out] = self.add(
                "ReduceMean", [self.get(inputs[0])], axes=[2, 3], keepdims=int(options.keepDims)
            )
        elif name == "RESHAPE":
            if len(self.shape(out)) == 4:
                raise ValueError("a reshape to a feature map")
            value = self._rows(inputs[0])
            self.values[out] = self.add(
                "Reshape", [value, self.weight(np.array(self.shape(out), np.int64))]
            )
        elif name == "CONCATENATION":
            rank = len(self.shape(out))
            axis = options.axis % rank
            if rank == 4:
                axis = {0: 0, 1: 2, 2: 3, 3: 1}[axis]
            value = self.add("Concat", [self.get(i) for i in inputs], axis=axis)
            self.values[out] = self._activated(value, options.fusedActivationFunction)
        elif name == "FULLY_CONNECTED":
            self.values[out] = self._dense_layer(inputs, options)
        else:
            raise ValueError(f"unknown operator {name}")

    def _convolution(self, name: str, inputs: list[int], options: Any) -> str:
        kernel = self.constants[inputs[1]].astype(np.float32)
        stride = (options.strideH, options.strideW)
        dilation = (options.dilationHFactor, options.dilationWFactor)
        shape = self.shape(inputs[0])
        if name == "CONV_2D":
            weights = kernel.transpose(0, 3, 1, 2)
            groups = shape[3] // kernel.shape[3]
        else:  # (1, kh, kw, channels * multiplier)
            weights = kernel.transpose(3, 0, 1, 2)
            groups = shape[3]
        args = [self.get(inputs[0]), self.weight(weights, f"w{inputs[1]}_{self.count}")]
        args += self._bias(inputs)
        value = self.add(
            "Conv",
            args,
            strides=list(stride),
            dilations=list(dilation),
            group=groups,
            pads=_same(shape[1:3], kernel.shape[1:3], stride, dilation, options.padding),
        )
        return self._activated(value, options.fusedActivationFunction)

    def _dense_layer(self, inputs: list[int], options: Any) -> str:
        matrix = self.constants[inputs[1]].astype(np.float32)
        value = self._rows(inputs[0])
        if len(self.shape(inputs[0])) != 2:
            value = self.add(
                "Reshape", [value, self.weight(np.array([-1, matrix.shape[1]], np.int64))]
            )
        args = [value, self.weight(matrix, f"w{inputs[1]}_{self.count}"), *self._bias(inputs)]
        return self._activated(self.add("Gemm", args, transB=1), options.fusedActivationFunction)

    def _bias(self, inputs: list[int]) -> list[str]:
        if len(inputs) < 3 or inputs[2] < 0:
            return []
        return [
            self.weight(self.constants[inputs[2]].astype(np.float32), f"b{inputs[2]}_{self.count}")
        ]


def _dequantised(values: Array, quantization: Any) -> Array:
    """Real values of a quantised constant, float32; the constant itself if it is not quantised."""
    if (
        quantization is None
        or quantization.scale is None
        or values.dtype not in (np.int8, np.uint8, np.int32)
    ):
        return values
    shape = [1] * values.ndim
    if len(quantization.scale) > 1:
        shape[quantization.quantizedDimension] = -1
    scale = np.asarray(quantization.scale, np.float64)
    zero = np.asarray(quantization.zeroPoint, np.float64)
    real: Array = ((values - zero.reshape(shape)) * scale.reshape(shape)).astype(np.float32)
    return real


def _same(size: Any, kernel: Any, stride: Any, dilation: Any, padding: int) -> list[int]:
    """ONNX pads (top, left, bottom, right) of TFLite's SAME, which puts the odd pixel at the end;
    zeros for VALID.
    """
    if padding == schema.Padding.VALID:
        return [0, 0, 0, 0]
    before = []
    after = []
    for n, k, s, d in zip(size, kernel, stride, dilation, strict=True):
        total = max((-(-n // s) - 1) * s + (k - 1) * d + 1 - n, 0)
        before.append(total // 2)
        after.append(total - total // 2)
    return before + after
