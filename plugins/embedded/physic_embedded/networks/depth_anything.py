"""Predict relative disparity with Depth Anything V2."""

from __future__ import annotations

import hashlib
import math
from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.networks.patch_tokens import PatchTokens, TokenStore
from physic_networks.pictures import IMAGENET_MEAN, letterbox

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from physic_core.types import Float32Array, UInt8Array
    from physic_networks.onnx_sessions import OnnxSession
    from physic_networks.pictures import Letterbox, Resampling

_ENCODED = "out_cast_fp16"  # output of the encoder: the class token, then one of each patch
_PATCH = 14  # px, side of the vision transformer's patches
# Patches: a photo that is longer by less is shrunk, and gets no further row or column of them.
_OVERHANG = 0.1
TOKENS = TokenStore()
"""Tokens of passes for a depth map, until the observer of the same photo reads them."""

_FILL = tuple(round(255 * mean) for mean in IMAGENET_MEAN)


def network_input_size(
    height: int, width: int, short_side: int = 518, max_tokens: int = 3600
) -> tuple[int, int]:
    """Return height and width of the network input: the multiples of 14 in which the photo fits.

    The short side is ``short_side`` px unless that gives more than about ``max_tokens`` patches,
    because long panoramas cost quadratic time. With 518 and 406 px, no usual aspect ratio is near
    the limit of another number of patches, so that a photo with a column less gets the same size.
    """
    scale = min(short_side / min(height, width), _PATCH * (max_tokens / (height * width)) ** 0.5)
    rows, columns = (
        max(1, math.ceil(side * scale / _PATCH - _OVERHANG)) * _PATCH for side in (height, width)
    )
    return rows, columns


def predict_disparity(
    session: OnnxSession,
    image: UInt8Array,
    short_side: int = 518,
    max_tokens: int = 3600,
    *,
    keep_tokens: bool = False,
) -> Float32Array:
    """Predict a disparity map at network resolution: an affine function of 1 / z, larger is nearer.

    The photo keeps its aspect ratio; the mean colour fills what it leaves of the input.

    Args:
        session: on ``depth_anything_v2_vits`` or ``depth_anything_v2_vits_int8``.
        image: (H, W, 3) uint8 RGB.
        short_side: px of the network's input.
        max_tokens: cap on the number of patches.
        keep_tokens: keep the tokens of this pass in :data:`TOKENS`, if somebody will read them.

    Returns:
        (h, w) float32, at least 0, of the photo alone; at most of the size that
        :func:`network_input_size` gives.
    """
    fed, photo = _network_input(image, short_side, max_tokens)

    def see(tokens: Float32Array) -> None:
        TOKENS.put(_token_key(session.name, fed), tokens)

    beside = {_ENCODED: see} if keep_tokens and TOKENS.readers else {}
    (answer,) = session.run(["depth"], {"image": fed}, keep=True, beside=beside)
    return np.asarray(photo.crop(answer[0]), dtype=np.float32)


def disparity_and_tokens(
    session: OnnxSession, image: UInt8Array, short_side: int, max_tokens: int
) -> tuple[Float32Array, PatchTokens]:
    """Return the map of :func:`predict_disparity` and the tokens of the same pass."""
    fed, photo = _network_input(image, short_side, max_tokens)
    answer, tokens = session.run(["depth", _ENCODED], {"image": fed}, keep=True)
    return np.asarray(photo.crop(answer[0]), np.float32), _patches(tokens, fed, photo)


def patch_tokens(
    graph: str,
    open_session: Callable[[str], OnnxSession],
    image: UInt8Array,
    short_side: int,
    max_tokens: int,
) -> PatchTokens:
    """Return the tokens (h, w, 384) of the encoder after its last norm: those of the pass that
    :func:`predict_disparity` made for the same photo, or of a pass of their own.

    Args:
        graph: ``depth_anything_v2_vits`` or ``depth_anything_v2_vits_int8``.
        open_session: opens it, only for a pass of its own.
        image: (H, W, 3) uint8 RGB.
        short_side: px of the network's input.
        max_tokens: cap on the number of patches.
    """
    fed, photo = _network_input(image, short_side, max_tokens)
    tokens = TOKENS.take(_token_key(graph, fed))
    if tokens is None:
        (tokens,) = open_session(graph).run([_ENCODED], {"image": fed})
    return _patches(tokens, fed, photo)


def _patches(tokens: Float32Array, fed: Float32Array, photo: Letterbox) -> PatchTokens:
    rows, columns = (side // _PATCH for side in fed.shape[2:])
    return PatchTokens(tokens[0, 1:].reshape(rows, columns, -1), _PATCH, photo)


def _network_input(
    image: UInt8Array, short_side: int, max_tokens: int
) -> tuple[Float32Array, Letterbox]:
    """Return the network's input (1, 3, h, w), and where the photo lies in it."""
    height, width = image.shape[:2]
    rows, columns = network_input_size(height, width, short_side, max_tokens)
    how: Resampling = "area" if rows < height else "bicubic"
    canvas, photo = letterbox(image, rows, columns, fill=_FILL, how=how)
    return np.ascontiguousarray(canvas.transpose(2, 0, 1)[None], np.float32), photo


def _token_key(graph: str, fed: Float32Array) -> Hashable:
    return graph, fed.shape, hashlib.blake2b(fed.data).digest()
