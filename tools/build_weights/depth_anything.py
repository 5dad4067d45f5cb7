"""Depth Anything V2 Small: the text and the weight blob of a Core ML program to ONNX with dynamic
height and width.

The program is fixed to 518 x 518 px, 37 x 37 patches. Here the patch grid is read off the input at
run time, and the positional embedding is resized to it inside the graph, as the authors' own code
does.
"""

from __future__ import annotations

import re
import struct
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

Array = np.ndarray[Any, Any]
GRID = 37
PATCH = 14
WIDTH = 384
HEADS = 6
END = np.iinfo(np.int64).max
DTYPES: dict[str, Any] = {
    "fp16": np.float16, "fp32": np.float32, "int32": np.int32, "bool": bool, "string": object,
    "uint64": np.uint64,
}  # fmt: skip
STATEMENT = re.compile(
    r"^\s*tensor<(\w+), \[([^\]]*)\]> (\w+) = (\w+)\((.*)\)"
    r'\[name = tensor<string, \[\]>\("[^"]*"\)(?:, val = tensor<(\w+), '
    r"\[([^\]]*)\]>\((.*)\))?\];\s*$"
)
LITERAL = re.compile(
    r'"[^"]*"|[-+]?0x[0-9a-f.]+p[-+]?\d+|true|false|[-+]?[\d.]+(?:e[-+]?\d+)?|inf|nan'
)
BLOB = re.compile(r"BLOBFILE\(.*offset = tensor<uint64, \[\]>\((\d+)\)\)")


def convert(program: str, blob: bytes) -> onnx.ModelProto:
    """The program as ONNX.

    Raises:
        ValueError: a statement that is not known here.
    """
    converter = _Converter(blob)
    for line in program.split("\n"):
        converter.statement(line)
    answer = re.search(r"\} -> \((\w+)\)", program)
    if answer is None:
        raise ValueError("the program has no result")
    graph = helper.make_graph(
        converter.nodes,
        "depth_anything_v2_vits",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "H", "W"])],
        [helper.make_tensor_value_info(answer[1], TensorProto.FLOAT, [1, "H", "W"])],
        list(converter.weights.values()),
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9)


def fuse_attention(model: onnx.ModelProto) -> None:
    """Replace the products and the softmax of each attention by one operator, which never holds all
    weights at once.

    With 2036 tokens the weights and their softmax are 100 MB each.
    """
    nodes = list(model.graph.node)
    maker = {name: node for node in nodes for name in node.output}
    # each of the names below has one user
    user = {name: node for node in nodes for name in node.input}
    fused: dict[str, list[onnx.NodeProto]] = {}
    dropped: set[str] = set()
    for softmax in [node for node in nodes if node.op_type == "Softmax"]:
        scores = maker[softmax.input[0]]
        scaled_query, transposed_key = (maker[name] for name in scores.input)
        weighted = user[softmax.output[0]]
        swapped = user[weighted.output[0]]
        result = user[swapped.output[0]]
        parts = [
            maker[name]
            for name in (scaled_query.input[0], transposed_key.input[0], weighted.input[1])
        ]
        slices = [maker[part.input[0]] for part in parts]
        by_part = maker[slices[0].input[0]]
        by_head = maker[by_part.input[0]]
        chain = [
            by_head,
            by_part,
            *slices,
            *parts,
            scaled_query,
            transposed_key,
            scores,
            softmax,
            weighted,
            swapped,
        ]
        dropped.update(node.output[0] for node in chain)
        names = [f"{result.output[0]}_{part}" for part in ("query", "key", "value")]
        fused[result.output[0]] = [
            helper.make_node("Split", [by_head.input[0]], names, axis=-1, num_outputs=3),
            helper.make_node(
                "MultiHeadAttention",
                names,
                [result.output[0]],
                domain="com.microsoft",
                num_heads=HEADS,
                scale=(WIDTH // HEADS) ** -0.5,
            ),
        ]
    del model.graph.node[:]
    for node in nodes:
        if node.output[0] not in dropped:
            model.graph.node.extend(fused.get(node.output[0], [node]))
    needed = {name for node in model.graph.node for name in node.input}
    for tensor in [tensor for tensor in model.graph.initializer if tensor.name not in needed]:
        model.graph.initializer.remove(tensor)
    model.opset_import.append(helper.make_opsetid("com.microsoft", 1))


def _literal(text: str, dtype: str, shape: list[int]) -> Any:
    tokens = LITERAL.findall(text)
    if dtype == "string":
        return tokens[0].strip('"')

    def number(token: str) -> Any:
        if dtype == "bool":
            return token == "true"
        if dtype == "int32":
            return int(token)
        return float.fromhex(token) if "x" in token else float(token)

    return np.array([number(t) for t in tokens], DTYPES[dtype]).reshape(shape)


class _Converter:
    def __init__(self, blob: bytes) -> None:
        self.blob = blob
        self.constants: dict[str, Any] = {}
        self.shapes: dict[str, list[int]] = {}
        self.weights: dict[str, onnx.TensorProto] = {}
        self.nodes: list[onnx.NodeProto] = []
        self.count = 0

    def statement(self, line: str) -> None:
        found = STATEMENT.match(line)
        if not found:
            if re.match(r"^\s*tensor<", line):
                raise ValueError(f"a statement that cannot be read: {line[:200]}")
            return
        dtype, dims, name, operator, arguments, _, _, value = found.groups()
        shape = [int(x) for x in dims.split(",") if x.strip()]
        self.shapes[name] = shape
        if operator == "const":
            at = BLOB.match(value)
            self.constants[name] = (
                self._blob(int(at[1]), shape, dtype) if at else _literal(value, dtype, shape)
            )
            return
        args = {q[1]: q[2] for q in re.finditer(r"(\w+) = (\([^)]*\)|\w+)", arguments)}
        self._operator(operator, name, shape, args)

    def _blob(self, offset: int, shape: list[int], dtype: str) -> Array:
        mark, _, size, start = struct.unpack_from("<IIQQ", self.blob, offset)
        if mark != 0xDEADBEEF:
            raise ValueError(f"no weight begins at byte {offset}")
        kind = np.dtype(DTYPES[dtype])
        return np.frombuffer(self.blob, kind, size // kind.itemsize, start).reshape(shape)

    def _value(self, name: str) -> str:
        """A tensor by name, entered among the weights if it is a constant; float16 becomes
        float32.
        """
        if name in self.constants and name not in self.weights:
            value = np.asarray(self.constants[name])
            value = value.astype(np.float32) if value.dtype == np.float16 else value
            self.weights[name] = numpy_helper.from_array(np.ascontiguousarray(value), name)
        return name

    def _weight(self, value: Array, name: str | None = None) -> str:
        self.count += 1
        name = name or f"_c{self.count}"
        self.weights[name] = numpy_helper.from_array(np.asarray(value), name)
        return name

    def _numbers(self, *values: int) -> str:
        return self._weight(np.array(values, np.int64))

    def _add(self, operator: str, inputs: list[str], out: str, **attributes: Any) -> str:
        self.nodes.append(helper.make_node(operator, inputs, [out], **attributes))
        return out

    def _size(self, factor: int, channels: int, tag: str) -> str:
        """Run-time shape (1, channels, factor * rows, factor * columns) of the patch grid."""
        grid = (
            self._add("Mul", ["_hw", self._numbers(factor, factor)], tag + "_m")
            if factor != 1
            else "_hw"
        )
        return self._add("Concat", [self._numbers(1, channels), grid], tag + "_sz", axis=0)

    def _positions(self, name: str) -> str:
        """The positional embedding resized to the patch grid."""
        table = np.asarray(self.constants[name]).astype(np.float32)
        self._weight(table[:, :1].copy(), "pos_cls")
        self._weight(table[:, 1:].reshape(1, GRID, GRID * WIDTH).copy(), "pos_grid")
        # The resized unit matrix holds the weights of the interpolation, and products are faster
        # than resizing.
        self._weight(np.eye(GRID, dtype=np.float32)[None, None], "pos_unit")
        for axis, name in ((0, "pos_rows"), (1, "pos_columns")):
            length = self._add("Gather", ["_hw", self._numbers(axis)], f"{name}_n", axis=0)
            size = self._add(
                "Concat", [self._numbers(1, 1), length, self._numbers(GRID)], f"{name}_sz", axis=0
            )
            self._add(
                "Resize", ["pos_unit", "", "", size], f"{name}_r",
                mode="cubic", cubic_coeff_a=-0.75, coordinate_transformation_mode="half_pixel",
            )  # fmt: skip
            self._add("Reshape", [f"{name}_r", self._numbers(-1, GRID)], name)
        self._add("MatMul", ["pos_rows", "pos_grid"], "pos_r")
        self._add("Reshape", ["pos_r", self._numbers(-1, GRID, WIDTH)], "pos_rg")
        self._add("MatMul", ["pos_columns", "pos_rg"], "pos_t3")
        self._add("Reshape", ["pos_t3", self._numbers(1, -1, WIDTH)], "pos_t")
        return self._add("Concat", ["pos_cls", "pos_t"], "pos_all", axis=1)

    def _operator(self, operator: str, name: str, shape: list[int], args: dict[str, str]) -> None:
        constant = lambda key: self.constants[args[key]]  # noqa: E731
        if operator in ("mul", "sub", "add"):
            pair = {}
            for side in ("x", "y"):
                tensor = args[side]
                table = tensor in self.constants and self.shapes[tensor] == [
                    1,
                    GRID * GRID + 1,
                    WIDTH,
                ]
                pair[side] = self._positions(tensor) if table else tensor
            self._add(operator.capitalize(), [self._value(pair["x"]), self._value(pair["y"])], name)
        elif operator in ("cast", "relu"):
            self._add(
                {"cast": "Identity", "relu": "Relu"}[operator], [self._value(args["x"])], name
            )
        elif operator in ("conv", "conv_transpose"):
            self._convolution(operator, name, shape, args)
        elif operator == "reshape":
            self._reshape(name, shape, args)
        elif operator == "squeeze":
            if shape != [1, GRID * PATCH, GRID * PATCH]:
                raise ValueError(f"squeeze to {shape}")
            self._add("Squeeze", [self._value(args["x"]), self._numbers(1)], name)
        elif operator == "transpose":
            order = [int(v) % len(shape) for v in constant("perm")]
            self._add("Transpose", [self._value(args["x"])], name, perm=order)
        elif operator == "concat":
            parts = [self._value(v.strip()) for v in args["values"].strip("()").split(",")]
            self._add("Concat", parts, name, axis=int(constant("axis")))
        elif operator == "layer_norm":
            inputs = [self._value(args[k]) for k in ("x", "gamma", "beta")]
            self._add(
                "LayerNormalization", inputs, name, axis=-1, epsilon=float(constant("epsilon"))
            )
        elif operator == "linear":
            matrix = np.asarray(constant("weight")).astype(np.float32).T.copy()
            weight = self._weight(matrix, args["weight"] + "_T")
            self._add("MatMul", [self._value(args["x"]), weight], name + "_mm")
            self._add("Add", [name + "_mm", self._value(args["bias"])], name)
        elif operator == "matmul":
            x = self._value(args["x"])
            y = self._value(args["y"])
            if "transpose_x" in args and bool(constant("transpose_x")):
                raise ValueError("a matrix product with its first factor transposed")
            if "transpose_y" in args and bool(constant("transpose_y")):
                y = self._add("Transpose", [y], name + "_yt", perm=[0, 1, 3, 2])
            self._add("MatMul", [x, y], name)
        elif operator == "softmax":
            self._add("Softmax", [self._value(args["x"])], name, axis=int(constant("axis")))
        elif operator == "gelu":
            if str(constant("mode")) != "EXACT":
                raise ValueError(f"gelu of mode {constant('mode')}")
            self._add("Gelu", [self._value(args["x"])], name)
        elif operator == "slice_by_index":
            self._slice(name, args)
        elif operator == "upsample_bilinear":
            if shape[2] != shape[3] or shape[2] % GRID:
                raise ValueError(f"upsampling to {shape}")
            corners = bool(constant("align_corners"))
            inputs = [self._value(args["x"]), "", "", self._size(shape[2] // GRID, shape[1], name)]
            mode = "align_corners" if corners else "half_pixel"
            self._add("Resize", inputs, name, mode="linear", coordinate_transformation_mode=mode)
        else:
            raise ValueError(f"unknown operator {operator}")

    def _convolution(
        self, operator: str, name: str, shape: list[int], args: dict[str, str]
    ) -> None:
        constant = lambda key: self.constants[args[key]]  # noqa: E731
        kind = str(constant("pad_type"))
        if kind not in ("valid", "custom"):
            raise ValueError(f"padding {kind}")
        top, bottom, left, right = map(int, constant("pad")) if kind == "custom" else [0] * 4
        self._add(
            "Conv" if operator == "conv" else "ConvTranspose",
            [self._value(args[k]) for k in ("x", "weight", "bias") if k in args],
            name,
            pads=[top, left, bottom, right],
            strides=list(map(int, constant("strides"))),
            dilations=list(map(int, constant("dilations"))),
            group=int(constant("groups")),
        )
        # the patch embedding: the grid is known now
        if shape == [1, WIDTH, GRID, GRID] and "_hw" not in self.shapes:
            self.shapes["_hw"] = [2]
            self._add("Shape", [name], "_shp")
            self._add(
                "Slice", ["_shp", self._numbers(2), self._numbers(4), self._numbers(0)], "_hw"
            )

    def _reshape(self, name: str, shape: list[int], args: dict[str, str]) -> None:
        if shape == [1, WIDTH, GRID, GRID]:
            size = self._size(1, WIDTH, name)
        else:
            free = [-1 if v in (GRID * GRID, GRID * GRID + 1) else v for v in shape]
            if free.count(-1) != 1:
                raise ValueError(f"reshape to {shape}")
            size = self._numbers(*free)
        self._add("Reshape", [self._value(args["x"]), size], name)

    def _slice(self, name: str, args: dict[str, str]) -> None:
        shape = self.shapes[args["x"]]
        none = np.zeros(len(shape), bool)
        begin, end = (np.array(self.constants[args[k]]).ravel() for k in ("begin", "end"))
        open_end, open_begin, squeezed = (
            np.array(self.constants[args[k]]).ravel() if k in args else none
            for k in ("end_mask", "begin_mask", "squeeze_mask")
        )
        first = [0 if mask else int(v) for mask, v in zip(open_begin, begin, strict=True)]
        last = []
        for i in range(len(shape)):
            whole = open_end[i] or (int(end[i]) == shape[i] and not squeezed[i])
            last.append(END if whole else (first[i] + 1 if squeezed[i] else int(end[i])))
        axes = [i for i in range(len(shape)) if not (first[i] == 0 and last[i] == END)]
        if any(
            shape[i] in (GRID, GRID * PATCH) or (last[i] != END and shape[i] >= GRID) for i in axes
        ):
            raise ValueError(f"a slice of the patch grid in {name}")
        dropped = [i for i in range(len(shape)) if squeezed[i]]
        bounds = [self._numbers(*[v[i] for i in axes]) for v in (first, last)]
        out = name + "_s" if dropped else name
        self._add("Slice", [self._value(args["x"]), *bounds, self._numbers(*axes)], out)
        if dropped:
            self._add("Squeeze", [out, self._numbers(*dropped)], name)
