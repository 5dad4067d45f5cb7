"""Patch-based completion: an image pyramid with nearest-patch fields, searched by PatchMatch and merged by voting.

Method: Wexler, Shechtman and Irani, "Space-time completion of video" (2007) for the search-and-vote rounds; Barnes et
al., "PatchMatch" (2009) for the search; Newson et al., "Video inpainting of complex scenes" (2014) for the two texture
channels, without which a rough floor is filled from the smoothest place in the photo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, UInt8Array

    Float = NDArray[np.float32]
    Int = NDArray[np.int64]

__all__ = ["fill_by_patches"]

_COARSEST_DEPTH_PX = 9.0  # on the coarsest level no pixel of the hole lies deeper than this
_MOVE_COST = (15000.0, 1500.0)  # squared grey levels for a source one image height above, one image width aside
_TEXTURE_WEIGHT = 2.0  # of the mean absolute gradient against a colour channel


@dataclass
class _Level:
    """Pyramid level: arrays padded by the patch radius on every side, with flat pixel indices into them."""

    channels: Float  # (H, W, 5) padded: RGB and two texture channels, 0-255; the hole is rewritten by each vote
    weight: Float  # (H, W) padded: trust in a target's pixel, 0 outside the image
    depth: Float  # (H, W) padded: distance into the hole, px; 0 outside it
    targets: Int  # (T,) patch centres that touch the hole
    source: BoolArray  # (H, W) padded: centres of patches that are wholly known
    hole: Int  # (P,) pixels to fill
    field: Int  # (T,) current nearest source of each target
    stride: int

    @property
    def flat(self) -> Float:
        return self.channels.reshape(-1, self.channels.shape[2])


def fill_by_patches(
    image: UInt8Array, mask: BoolArray, *, radius: int, working_px: int, rounds: int, rng: np.random.Generator
) -> UInt8Array:
    """Fill a hole with patches from the unmasked part of the photo.

    Args:
        image: (H, W, 3) uint8.
        mask: (H, W) bool, True = fill; neither empty nor full.
        radius: patch radius on the working image, px.
        working_px: pixels of the hole on the working image.
        rounds: search-and-vote rounds on each level.
        rng: draws the random search.

    Returns:
        (H, W, 3) uint8; only masked pixels are meaningful.

    Raises:
        InputError: no patch of the photo is wholly unmasked.
    """
    factor = max(1, int(np.ceil(np.sqrt(np.count_nonzero(mask) / working_px))))
    channels = np.concatenate([image.astype(np.float32), _texture(image, mask)], axis=2)
    small, hole, inside = _shrink(channels, mask, np.ones_like(mask), factor)
    pyramid = [(small, hole, inside)]
    while _depth(pyramid[-1][1]) > _COARSEST_DEPTH_PX and min(pyramid[-1][1].shape) > 8 * radius:
        coarser = _shrink(*pyramid[-1], 2)
        if not _sources(coarser[1], coarser[2], radius).any():
            break
        pyramid.append(coarser)
    if not _sources(pyramid[0][1], pyramid[0][2], radius).any():
        side = (2 * radius + 1) * factor
        raise InputError(
            f"No {side} x {side} px square of the image is free of the mask: use a smaller patch_radius_px."
        )

    level: _Level | None = None
    distance: Float = np.zeros(0, np.float32)
    for pixels, hole, inside in reversed(pyramid):
        coarsest = level is None
        level = _make_level(pixels, hole, inside, radius, level, rng)
        if coarsest:
            _fill_by_layers(level, radius, rng)
        for _ in range(rounds):
            distance = _search(level, radius, rng)
            _vote(level, radius, distance)
    assert level is not None
    if factor == 1:
        colours = _unpad(level.channels, radius)[:, :, :3]
        filled: UInt8Array = np.clip(colours + 0.5, 0, 255).astype(np.uint8)
        return filled
    return _copy_full_resolution(image, mask, level, distance, radius, factor)


def _texture(image: UInt8Array, mask: BoolArray) -> Float:
    """Return the mean absolute gradients along x and y over 5 x 5 known pixels, (H, W, 2)."""
    import cv2

    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    known = cv2.erode((~mask).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
    slopes = [np.abs(cv2.Sobel(gray, cv2.CV_32F, dx, 1 - dx, ksize=1)) * known for dx in (1, 0)]
    share = np.maximum(cv2.boxFilter(known, -1, (5, 5)), 1e-6)
    texture: Float = np.stack([cv2.boxFilter(s, -1, (5, 5)) / share for s in slopes], axis=2)
    return _TEXTURE_WEIGHT * texture


def _shrink(channels: Float, hole: BoolArray, inside: BoolArray, factor: int) -> tuple[Float, BoolArray, BoolArray]:
    """Downsample by means over known pixels of factor x factor blocks; a block with a hole pixel is hole."""
    if factor == 1:
        return channels, hole, inside
    height, width = hole.shape
    pad = ((0, -height % factor), (0, -width % factor))
    channels = np.pad(channels, (*pad, (0, 0)), mode="edge")
    hole, inside = np.pad(hole, pad), np.pad(inside, pad)
    known = inside & ~hole

    def blocks(x: NDArray[np.generic]) -> Any:
        return x.reshape(x.shape[0] // factor, factor, x.shape[1] // factor, factor, *x.shape[2:])

    count = blocks(known).sum(axis=(1, 3), dtype=np.float32)
    total = blocks(channels * known[..., None]).sum(axis=(1, 3), dtype=np.float32)
    mean = total / np.maximum(count, 1)[..., None]
    return mean, blocks(hole).any(axis=(1, 3)), blocks(inside).all(axis=(1, 3))


def _depth(hole: BoolArray) -> float:
    """Return the largest distance from a hole pixel to the hole's border, px."""
    import cv2

    return float(cv2.distanceTransform(np.pad(hole, 1).astype(np.uint8), cv2.DIST_L2, 3).max())


def _sources(hole: BoolArray, inside: BoolArray, radius: int) -> BoolArray:
    """Return the centres of fully known patches inside the image."""
    import cv2

    usable = np.pad(inside & ~hole, radius).astype(np.uint8)
    eroded = cv2.erode(usable, np.ones((2 * radius + 1,) * 2, np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    usable_centres: BoolArray = eroded.astype(bool)
    return usable_centres


def _make_level(
    channels: Float, hole: BoolArray, inside: BoolArray, radius: int, coarser: _Level | None, rng: np.random.Generator
) -> _Level:
    """Build a pyramid level, initialised from the coarser one."""
    import cv2

    source = _sources(hole, inside, radius)
    near = cv2.dilate(hole.astype(np.uint8), np.ones((2 * radius + 1,) * 2, np.uint8)).astype(bool)
    targets = np.flatnonzero(np.pad(near, radius))
    # Wexler's confidence: pixels deep in the hole are guesses, and count less when patches are compared.
    depth = cv2.distanceTransform(hole.astype(np.uint8), cv2.DIST_L2, 3)
    weight = np.pad((1.3**-depth * inside).astype(np.float32), radius)
    stride = hole.shape[1] + 2 * radius
    filled = channels.copy()
    all_sources = np.flatnonzero(source)
    field = all_sources[rng.integers(len(all_sources), size=len(targets))]
    if coarser is None:
        filled[hole] = _smooth_fill(channels, hole)[hole]
    else:
        upper = cv2.resize(_unpad(coarser.channels, radius), None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        filled[hole] = upper[: hole.shape[0], : hole.shape[1]][hole]
        inherited = _upsample_field(coarser, targets, stride, radius)
        ok = source.reshape(-1)[inherited]
        field[ok] = inherited[ok]
    padded = np.pad(filled, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    return _Level(
        padded, weight, np.pad(depth, radius), targets, source, np.flatnonzero(np.pad(hole, radius)), field, stride
    )


def _fill_by_layers(level: _Level, radius: int, rng: np.random.Generator) -> None:
    """Fill the coarsest level layer by layer from the border; each layer is matched against filled pixels."""
    trust, holes = level.weight.copy(), level.hole
    depth = level.depth.reshape(-1)
    inner = 0.0
    while inner < depth.max():
        level.weight[...] = np.where(level.depth <= inner, trust, 0)
        layer = holes[(depth[holes] > inner) & (depth[holes] <= inner + 1.5)]
        for _ in range(3):
            distance = _search(level, radius, rng)
        level.hole = layer
        _vote(level, radius, distance)
        level.hole = holes
        inner += 1.5
    level.weight[...] = trust


def _upsample_field(coarser: _Level, targets: Int, stride: int, radius: int) -> Int:
    """Return the source of each target from the coarser level; pixel 0 if there is none."""
    lookup = np.full(coarser.source.size, -1, np.int64)
    lookup[coarser.targets] = coarser.field
    y, x = np.divmod(targets, stride)
    y, x = y - radius, x - radius
    parent = lookup[(y // 2 + radius) * coarser.stride + x // 2 + radius]
    sy, sx = np.divmod(np.maximum(parent, 0), coarser.stride)
    sy, sx = 2 * (sy - radius) + y % 2, 2 * (sx - radius) + x % 2
    return np.where(parent >= 0, (sy + radius) * stride + sx + radius, 0)


def _smooth_fill(channels: Float, hole: BoolArray) -> Float:
    """Fill a hole with repeated means of the known surroundings."""
    import cv2

    known = (~hole).astype(np.float32)
    values = channels * known[..., None]
    for size in (3, 7, 15, 31, 63, 127, 255):
        weight = cv2.blur(known, (size, size), borderType=cv2.BORDER_REPLICATE)
        mean = cv2.blur(values, (size, size), borderType=cv2.BORDER_REPLICATE)
        fresh = (known == 0) & (weight > 1e-4)
        values[fresh] = mean[fresh] / weight[fresh][:, None]
        known[fresh] = 1.0
    values[known == 0] = channels[~hole].mean(axis=0)
    return values


def _offsets(radius: int, stride: int) -> Int:
    """Return the flat index offsets of a patch's pixels."""
    around = np.arange(-radius, radius + 1)
    return (around[:, None] * stride + around[None, :]).reshape(-1)


def _search(level: _Level, radius: int, rng: np.random.Generator) -> Float:
    """Run one PatchMatch round over all targets, and update ``level.field``.

    Returns:
        (T,) weighted mean squared difference to the nearest source.
    """
    offsets = _offsets(radius, level.stride)
    around = level.targets[:, None] + offsets
    wanted = level.flat[around]  # (T, patch, channels)
    weight = level.weight.reshape(-1)[around]
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    root = np.sqrt(weight)[..., None]
    # Gravity orders photos by rows: floor lies beside floor. A far source must look that much better.
    height, width = level.source.shape
    home_y, home_x = np.divmod(level.targets, level.stride)
    wanted = (wanted * root).reshape(len(level.targets), -1)

    def measure(rows: Int, sources: Int) -> Float:
        found = level.flat[sources[:, None] + offsets]
        difference = (found * root[rows]).reshape(len(rows), -1) - wanted[rows]
        y, x = np.divmod(sources, level.stride)
        away = _MOVE_COST[0] * ((y - home_y[rows]) / height) ** 2 + _MOVE_COST[1] * ((x - home_x[rows]) / width) ** 2
        distance: Float = np.einsum("ij,ij->i", difference, difference) + away.astype(np.float32)
        return distance

    everyone = np.arange(len(level.targets))
    best = measure(everyone, level.field)
    is_source = level.source.reshape(-1)

    def offer(sources: Int) -> None:
        rows = np.flatnonzero(is_source[sources] & (sources != level.field))
        if len(rows):
            cost = measure(rows, sources[rows])
            better = rows[cost < best[rows]]
            best[better] = cost[cost < best[rows]]
            level.field[better] = sources[better]

    row_of = np.full(level.source.size, -1, np.int64)
    row_of[level.targets] = everyone
    for step in (1, 3, 1):
        for shift in (step, -step, step * level.stride, -step * level.stride):
            neighbour = row_of[np.clip(level.targets + shift, 0, level.source.size - 1)]
            offer(np.where(neighbour >= 0, np.clip(level.field[neighbour] - shift, 0, level.source.size - 1), 0))
    reach = max(height, width)
    while reach >= 1:
        y, x = np.divmod(level.field, level.stride)
        y = np.clip(y + rng.integers(-reach, reach + 1, len(y)), 0, height - 1)
        x = np.clip(x + rng.integers(-reach, reach + 1, len(x)), 0, width - 1)
        offer(y * level.stride + x)
        reach //= 2
    return best


def _vote(level: _Level, radius: int, distance: Float) -> None:
    """Rewrite the hole by weighted votes of all patches over each pixel."""
    sigma = max(float(np.percentile(distance, 25)) / 2, 1e-3)
    # During the first fill, patches that see nothing yet have weight 0 at their centre and hardly count.
    trust = (np.exp(-distance / (2 * sigma)) + 1e-6).astype(np.float32)
    trust *= level.weight.reshape(-1)[level.targets] + 1e-6
    total = np.zeros_like(level.flat)
    count = np.zeros(len(total), np.float32)
    for offset in _offsets(radius, level.stride):
        # Targets are distinct, so within one offset no pixel is written twice.
        total[level.targets + offset] += level.flat[level.field + offset] * trust[:, None]
        count[level.targets + offset] += trust
    level.flat[level.hole] = total[level.hole] / count[level.hole][:, None]


def _unpad(x: Float, radius: int) -> Float:
    """Remove the padding of a level."""
    return x[radius : x.shape[0] - radius, radius : x.shape[1] - radius]


def _copy_full_resolution(
    image: UInt8Array, mask: BoolArray, level: _Level, distance: Float, radius: int, factor: int
) -> UInt8Array:
    """Copy full-resolution pixels along the field, blended where neighbouring cells disagree."""
    height, width = mask.shape
    row_of = np.full(level.source.size, -1, np.int64)
    row_of[level.targets] = np.arange(len(level.targets))
    y, x = np.nonzero(mask)
    cell_y, cell_x = (y + 0.5) / factor - 0.5, (x + 0.5) / factor - 0.5
    base_y, base_x = np.floor(cell_y).astype(np.int64), np.floor(cell_x).astype(np.int64)
    sigma = max(float(np.percentile(distance, 25)) / 2, 1e-3)
    total = np.zeros((len(y), 3), np.float32)
    count = np.zeros(len(y), np.float32)
    for dy in (0, 1):
        for dx in (0, 1):
            ty, tx = base_y + dy, base_x + dx
            near = (1 - np.abs(cell_y - ty)) * (1 - np.abs(cell_x - tx))
            padded = (np.clip(ty, 0, None) + radius) * level.stride + np.clip(tx, 0, None) + radius
            row = row_of[np.clip(padded, 0, level.source.size - 1)]
            sy, sx = np.divmod(level.field[row], level.stride)
            sy, sx = y + factor * (sy - radius - ty), x + factor * (sx - radius - tx)
            usable = (row >= 0) & (sy >= 0) & (sx >= 0) & (sy < height) & (sx < width)
            sy, sx = np.clip(sy, 0, height - 1), np.clip(sx, 0, width - 1)
            usable &= ~mask[sy, sx]
            # A cubed share keeps one source in charge of most pixels: sharp inside a cell, mixed only at its border.
            trust = np.where(usable, near**3 * (np.exp(-distance[row] / (2 * sigma)) + 1e-6), 0).astype(np.float32)
            total += image[sy, sx] * trust[:, None]
            count += trust
    answer = image.copy()
    settled = count > 0
    fallback = level.flat[((y // factor) + radius) * level.stride + x // factor + radius, :3]
    colours = np.where(settled[:, None], total / np.maximum(count, 1e-12)[:, None], fallback)
    answer[y, x] = np.clip(colours + 0.5, 0, 255).astype(np.uint8)
    return answer
