"""A binary glTF file: accessors and images in one buffer, and the JSON tree."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import AnyArray

ARRAY = 34962
INDICES = 34963
"""Targets of buffer views: vertex attributes and indices."""

_COMPONENTS = {"uint8": 5121, "uint16": 5123, "uint32": 5125, "float32": 5126}
_TYPES = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


class GlbBuilder:
    """Collect the tree and the binary chunk of a GLB file.

    Attributes:
        tree: the JSON, to which nodes, meshes, ... are added with :meth:`add`.
    """

    def __init__(self, **asset: Any) -> None:
        self.tree: dict[str, Any] = {"asset": {"version": "2.0", **asset}}
        self._chunks: list[bytes] = []
        self._size = 0
        self._accessors: dict[tuple[str, bytes], int] = {}

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an entry to a list of the tree ("nodes", "meshes", ...), and return its index."""
        entries = self.tree.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def add_view(self, content: bytes, target: int | None = None) -> int:
        """Append bytes to the binary chunk, and return the index of their buffer view."""
        entry = {"buffer": 0, "byteOffset": self._size, "byteLength": len(content)}
        if target is not None:
            entry["target"] = target
        padded = content + b"\0" * (-len(content) % 4)
        self._chunks.append(padded)
        self._size += len(padded)
        return self.add("bufferViews", entry)

    def add_material(self, entry: dict[str, Any]) -> int:
        """Return the index of a material, which is added unless the file has one like it."""
        materials: list[dict[str, Any]] = self.tree.get("materials", [])
        return materials.index(entry) if entry in materials else self.add("materials", entry)

    def add_texture(self, content: bytes, mime: str, name: str) -> int:
        """Append a picture that is not repeated at its edges, and return the index of its
        texture.
        """
        source = self.add(
            "images", {"bufferView": self.add_view(content), "mimeType": mime, "name": name}
        )
        if "samplers" not in self.tree:
            self.add(
                "samplers", {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}
            )
        return self.add("textures", {"source": source, "sampler": 0})

    def add_accessor(
        self,
        values: AnyArray,
        target: int | None = None,
        *,
        with_bounds: bool = False,
        normalized: bool = False,
    ) -> int:
        """Append an array (N, ...) of float32 or unsigned integers, and return the index of its
        accessor.

        Equal arrays, such as the faces of several people, are written once.

        Args:
            values: matrices are (N, 4, 4), by rows.
            target: ARRAY, INDICES or None.
            with_bounds: whether to state minimum and maximum, which positions must have.
            normalized: whether the largest integer stands for 1.
        """
        values = np.ascontiguousarray(np.swapaxes(values, -1, -2) if values.ndim == 3 else values)
        entry: dict[str, Any] = {
            "componentType": _COMPONENTS[values.dtype.name],
            "count": len(values),
            "type": _TYPES[values.shape[1:]],
        }
        if normalized:
            entry["normalized"] = True
        if with_bounds:
            entry |= {
                "min": np.atleast_1d(values.min(0)).tolist(),
                "max": np.atleast_1d(values.max(0)).tolist(),
            }
        key = f"{entry}{target}", values.tobytes()
        if key not in self._accessors:
            entry["bufferView"] = self.add_view(key[1], target)
            self._accessors[key] = self.add("accessors", entry)
        return self._accessors[key]

    def content(self) -> bytes:
        """Return the GLB file."""
        tree = self.tree | ({"buffers": [{"byteLength": self._size}]} if self._size else {})
        text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        binary = b"".join(self._chunks)
        parts = struct.pack("<II", len(text), 0x4E4F534A) + text
        if binary:
            parts += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<III", 0x46546C67, 2, 12 + len(parts)) + parts
