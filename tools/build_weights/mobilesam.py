"""MobileSAM: the checkpoint and model definition of a source distribution to an encoder and a
decoder in ONNX.

The model definition is imported from the distribution, at build time only. Encoder: image float32
(1, 3, H, W), 0 to 255, its longer side 1024 px; normalisation and padding happen in the graph.
Decoder: points and labels (1 on, 0 off, 2 and 3 corners of a box, -1 padding) and a mask to start
from.
"""

from __future__ import annotations

import io
import sys
import types
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn
from torch.nn import functional

SIZE = 1024
GRID = 64
PATCH = 16
MARGIN = 64
"""Least padding that the encoder computes beside a photo, px: features there change those of the
photo.
"""


def load(folder: Path, checkpoint: Path) -> Any:
    """The model from the unpacked distribution.

    Its file imports a few names of packages that play no part in inference; stand-ins serve.
    """

    class DropPath(nn.Module):
        def __init__(self, drop_prob: float | None = None) -> None:
            super().__init__()

        def forward(self, x: Tensor) -> Tensor:
            return x

    modules = {
        name: types.ModuleType(name)
        for name in (
            *("timm", "timm.models", "timm.models.layers", "timm.models.registry"),
            *("torchvision", "torchvision.ops", "torchvision.ops.boxes"),
            *("torchvision.transforms", "torchvision.transforms.functional"),
        )
    }
    layers: Any = modules["timm.models.layers"]
    layers.DropPath = DropPath
    layers.trunc_normal_ = nn.init.trunc_normal_
    layers.to_2tuple = lambda x: x if isinstance(x, tuple) else (x, x)
    registry: Any = modules["timm.models.registry"]
    registry.register_model = lambda f: f
    for name, module in modules.items():
        if name.startswith("torchvision"):
            for attribute in ("batched_nms", "box_area", "resize", "to_pil_image", "nms"):
                setattr(module, attribute, None)
        sys.modules.setdefault(name, module)
    sys.path.insert(0, str(folder / "segment_any"))
    import mobile_sam

    return mobile_sam.sam_model_registry["vit_t"](str(checkpoint)).eval()


class _Encoder(nn.Module):
    """TinyViT on the photo and a margin; the rest of the features are those of an empty image."""

    def __init__(self, sam: Any) -> None:
        super().__init__()
        self.e = sam.image_encoder
        self.register_buffer("mean", sam.pixel_mean.reshape(1, 3, 1, 1))
        with torch.no_grad():
            self.e.patch_embed.seq[0].c.weight /= sam.pixel_std.reshape(1, 3, 1, 1)
            self.register_buffer("empty", self._features(torch.zeros(1, 3, SIZE, SIZE)))

    def forward(self, image: Tensor) -> Any:
        padding = (_padding(length) for length in reversed(image.shape[2:]))
        features = self._features(
            functional.pad(image - self.mean, [p for end in padding for p in (0, end)])
        )
        rows, columns = features.shape[2:]
        cells = torch.arange(GRID)
        computed = (cells[:, None] < rows) & (cells < columns)
        return torch.where(
            computed, functional.pad(features, (0, GRID - columns, 0, GRID - rows)), self.empty
        )

    def _features(self, x: Tensor) -> Any:
        """Features (1, 256, H / 16, W / 16) of a scaled image (1, 3, H, W)."""
        x = self.e.patch_embed(x)
        for block in self.e.layers[0].blocks:
            x = block(x)
        for before, layer in pairwise(self.e.layers):
            merge = before.downsample
            x = merge.conv3(merge.act(merge.conv2(merge.act(merge.conv1(x)))))
            windows = _Windows.of(layer.blocks[0], x)
            for block in layer.blocks:
                x = _block(block, x, windows)
        return self.e.neck(x)


def _padding(length: Any) -> Any:
    """Pixels to add to a side of the photo."""
    return torch.clamp((length + MARGIN + PATCH - 1) // PATCH * PATCH, max=SIZE) - length


@dataclass(frozen=True)
class _Windows:
    """Square windows of features (1, C, height, width), the last ones filled with zeros.

    All blocks of a layer share them, so that the graph computes each of its shapes once.
    """

    side: int
    channels: int
    height: Any
    width: Any
    columns: Any

    @classmethod
    def of(cls, block: Any, features: Tensor) -> _Windows:
        height, width = features.shape[2:]
        side = block.window_size
        return cls(side, block.dim, height, width, (width + side - 1) // side)

    def split(self, tokens: Tensor) -> Tensor:
        """The tokens (1, height, width, C) of each window, (windows, side * side, C)."""
        side = self.side
        channels = self.channels
        padded = functional.pad(tokens, (0, 0, 0, -self.width % side, 0, -self.height % side))
        windows = padded.reshape(-1, side, self.columns, side, channels).transpose(1, 2)
        return windows.reshape(-1, side * side, channels)

    def join(self, windows: Tensor) -> Tensor:
        """Reverse ``split``."""
        side = self.side
        channels = self.channels
        rows = windows.reshape(-1, self.columns, side, side, channels).transpose(1, 2)
        return rows.reshape(1, -1, self.columns * side, channels)[:, : self.height, : self.width]


def _block(block: Any, x: Tensor, windows: _Windows) -> Tensor:
    """Attention, convolution and MLP of one block on features (1, C, H, W)."""
    tokens = x.permute(0, 2, 3, 1)
    tokens = tokens + windows.join(_attention(block.attn, windows.split(tokens), windows.side**2))
    convolved = block.local_conv(tokens.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
    return (convolved + block.mlp(convolved)).permute(0, 3, 1, 2)


def _attention(attention: Any, x: Tensor, count: int) -> Any:
    """Attention within windows (windows, count, C)."""
    parts = attention.qkv(attention.norm(x)).reshape(
        -1, count, attention.num_heads, 2 * attention.key_dim + attention.d
    )
    query, key, value = (
        part.transpose(1, 2)
        for part in parts.split([attention.key_dim, attention.key_dim, attention.d], 3)
    )
    weights = (query @ key.transpose(2, 3) * attention.scale + attention.ab).softmax(-1)
    return attention.proj((weights @ value).transpose(1, 2).reshape(-1, count, attention.dh))


class _Decoder(nn.Module):
    def __init__(self, sam: Any) -> None:
        super().__init__()
        self.p = sam.prompt_encoder
        self.d = sam.mask_decoder

    def forward(
        self, image_embeddings: Tensor, point_coords: Tensor, point_labels: Tensor,
        mask_input: Tensor, has_mask_input: Tensor,
    ) -> Any:  # fmt: skip
        e = self.p.pe_layer._pe_encoding((point_coords + 0.5) / SIZE)
        label = point_labels.unsqueeze(-1)
        e = e * (label != -1).float() + self.p.not_a_point_embed.weight * (label == -1).float()
        for i in range(4):
            e = e + self.p.point_embeddings[i].weight * (label == i).float()
        given = has_mask_input * self.p.mask_downscaling(mask_input)
        d = given + (1 - has_mask_input) * self.p.no_mask_embed.weight.reshape(1, -1, 1, 1)
        # Tied to an input, or the exporter would fold it into a constant of 4 MB.
        g = (torch.arange(GRID, dtype=torch.float32) + 0.5) / GRID + 0 * has_mask_input
        xy = torch.stack([g[None, :].expand(GRID, GRID), g[:, None].expand(GRID, GRID)], -1)
        pe = self.p.pe_layer._pe_encoding(xy).permute(2, 0, 1).unsqueeze(0)
        return self.d.predict_masks(
            image_embeddings=image_embeddings,
            image_pe=pe,
            sparse_prompt_embeddings=e,
            dense_prompt_embeddings=d,
        )


def _export(
    module: nn.Module, args: tuple[Tensor, ...], inputs: list[str], outputs: list[str], dynamic: Any
) -> Any:
    file = io.BytesIO()
    with torch.no_grad():
        torch.onnx.export(
            module, args, file, input_names=inputs, output_names=outputs, dynamic_axes=dynamic,
            opset_version=17, dynamo=False,
        )  # fmt: skip
    return onnx.load_from_string(file.getvalue())


def export_encoder(sam: Any) -> onnx.ModelProto:
    """The image encoder, its attention tables shared."""
    encoder = _Encoder(sam).eval()
    dynamic = {"image": {2: "H", 3: "W"}}
    model = _export(
        encoder, (torch.rand(1, 3, 1024, 683) * 255,), ["image"], ["image_embeddings"], dynamic
    )
    constants_to_weights(model)
    share_bias_tables(model, encoder)
    return model


def export_decoder(sam: Any) -> onnx.ModelProto:
    """The prompt encoder and mask decoder."""
    args = (
        torch.rand(1, 256, GRID, GRID),
        torch.rand(1, 5, 2) * SIZE,
        torch.tensor([[1.0, 0, 2, 3, -1]]),
        torch.zeros(1, 1, 256, 256),
        torch.zeros(1),
    )
    inputs = ["image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input"]
    dynamic = {"point_coords": {1: "N"}, "point_labels": {1: "N"}}
    model = _export(_Decoder(sam).eval(), args, inputs, ["low_res_masks", "iou"], dynamic)
    constants_to_weights(model)
    return model


def share_bias_tables(model: onnx.ModelProto, encoder: nn.Module) -> int:
    """Replace expanded attention biases (heads, N, N) by their small table and a Gather; return how
    many.
    """
    weights = {t.name: t for t in model.graph.initializer}
    indices: set[str] = set()
    nodes = []
    for module in encoder.modules():
        if not hasattr(module, "attention_bias_idxs"):
            continue
        expanded = module.ab.numpy()
        table = module.attention_biases.detach().numpy()
        index = module.attention_bias_idxs.numpy()
        for name, tensor in list(weights.items()):
            if list(tensor.dims) != list(expanded.shape) or not np.array_equal(
                numpy_helper.to_array(tensor), expanded
            ):
                continue
            key = f"bias_index_{index.shape[0]}"
            if key not in indices:
                indices.add(key)
                model.graph.initializer.append(
                    numpy_helper.from_array(index.astype(np.int16), key + ".i16")
                )
                nodes.append(helper.make_node("Cast", [key + ".i16"], [key], to=TensorProto.INT64))
            model.graph.initializer.remove(tensor)
            weights.pop(name)
            model.graph.initializer.append(numpy_helper.from_array(table, name + ".table"))
            nodes.append(helper.make_node("Gather", [name + ".table", key], [name], axis=1))
    rest = list(model.graph.node)
    del model.graph.node[:]
    model.graph.node.extend(nodes + rest)
    return sum(n.op_type == "Gather" for n in nodes)


def constants_to_weights(model: onnx.ModelProto, smallest: int = 64) -> None:
    """Constant nodes with at least ``smallest`` floats become weights, which can be stored in fewer
    bits.
    """
    kept = []
    for node in model.graph.node:
        value = (
            node.attribute[0].t
            if node.op_type == "Constant" and node.attribute[0].name == "value"
            else None
        )
        if (
            value is not None
            and value.data_type == TensorProto.FLOAT
            and int(np.prod(value.dims)) >= smallest
        ):
            model.graph.initializer.append(
                numpy_helper.from_array(numpy_helper.to_array(value), node.output[0])
            )
        else:
            kept.append(node)
    del model.graph.node[:]
    model.graph.node.extend(kept)
