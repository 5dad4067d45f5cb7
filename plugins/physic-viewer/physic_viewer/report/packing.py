"""Pack arrays as base64 text for the page: positions in 16 bits, flags in one bit."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import UInt8Array

_STEPS = 65535


def pack_points(points: NDArray[np.floating[Any]]) -> dict[str, Any]:
    """Pack finite points (N, 3), metres, in 16 bits per axis of their bounding box.

    Returns:
        ``count``, ``origin`` and ``step`` (metres, per axis) and ``data``: N x 3 little-endian uint16 q in base64. A
        point is ``origin + step * q``; its error is at most half a step, 0.15 mm in a box of 20 m.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    low = points.min(0) if len(points) else np.zeros(3)
    step = (points.max(0) - low) / _STEPS if len(points) else np.ones(3)
    step = np.where(step > 0, step, 1.0)
    levels = np.clip(np.round((points - low) / step), 0, _STEPS).astype("<u2")
    return {"count": len(points), "origin": low.tolist(), "step": step.tolist(), "data": _text(levels.tobytes())}


def pack_indices(indices: NDArray[np.integer[Any]]) -> dict[str, Any]:
    """Pack vertex ids: ``bits`` is 16 or 32, ``data`` are little-endian unsigned integers in base64."""
    bits = 16 if not indices.size or int(indices.max()) < 1 << 16 else 32
    return {"bits": bits, "data": _text(np.ascontiguousarray(indices, f"<u{bits // 8}").tobytes())}


def pack_bytes(values: NDArray[Any]) -> str:
    """Pack integers from 0 to 255 in base64."""
    return _text(np.ascontiguousarray(values, np.uint8).tobytes())


def pack_flags(flags: NDArray[np.bool_]) -> str:
    """Pack flags as bits, the first one the lowest of the first byte, in base64."""
    return _text(np.packbits(flags.ravel(), bitorder="little").tobytes())


def photo_jpeg(image: UInt8Array, longest: int, quality: int) -> str:
    """Return an image (H, W, 3) RGB as a data URL of a JPEG, with its longer side reduced to ``longest`` px at most."""
    picture = Image.fromarray(np.ascontiguousarray(image))
    picture.thumbnail((longest, longest))
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=quality)
    return f"data:image/jpeg;base64,{_text(buffer.getvalue())}"


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
