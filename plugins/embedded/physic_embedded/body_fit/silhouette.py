"""Compare the outlines of fitted bodies with people's masks: pairs of points that the next fit
draws together.

Clothes and hair make masks wider than bodies, and other people, furniture and the border of the
photo make them smaller. Pairs therefore have a side: a body that reaches outside its mask is drawn
in, where the depth of the photo shows nothing in front of the person, and a mask that reaches
outside its body by more than clothes draws the body out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from scipy.spatial import cKDTree

from physic_core.body import JOINT_NAMES
from physic_core.geometry import rasterize
from physic_core.types import SURE_CONFIDENCE
from physic_embedded.body_fit.fit_problem import OutlinePairs

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, FloatArray, Int64Array, People, Pointmap
    from physic_embedded.body_fit.fit import FittedBodies
    from physic_embedded.body_fit.observations import BodyObservations


_CROP_SIDE = 192  # px, of the picture in which outlines are compared
_PAIRS = 64  # points on each outline
_CLOTHES = 0.015  # sizes of the person by which clothes and hair reach outside the body
_RIM = 0.01  # sizes of the person by which masks are too small
_REACH = 0.12  # sizes of the person; outlines farther apart belong to other objects
_SAME_DIRECTION = 0.6  # least cosine between the outlines' normals
_NEARER = 0.95  # of the person's depth; what is nearer hides the person
_FEWEST_SEEN = 0.7  # share of these that a usable mask holds
_CLOSE = 0.03  # sizes of the person between a keypoint and the mask that holds it
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")


@dataclass(frozen=True)
class _Outline:
    """Points on an outline (n, 2) px of the crop, and its outward unit normals (n, 2)."""

    points: FloatArray
    normals: FloatArray

    def spaced(self) -> _Outline:
        """Return evenly spaced points of the outline, as many as there are pairs."""
        rows = np.linspace(0, len(self.points), _PAIRS, endpoint=False).astype(int)
        return _Outline(self.points[rows], self.normals[rows])


def outline_pairs(
    model: BodyModel,
    fit: FittedBodies,
    observations: BodyObservations,
    people: People,
    photo: Pointmap | None,
) -> OutlinePairs:
    """Pair the outlines of N fitted bodies with their masks.

    People with unusable masks get pairs of weight zero.

    Args:
        model: that was fitted.
        fit: of the people, camera frame.
        observations: of the people.
        people: their masks.
        photo: shows what is in front of people; without it, bodies that reach outside are not drawn
            in.
    """
    with torch.no_grad():
        vertices = model(fit.rotations, fit.betas, fit.transl).vertices.numpy()
    depth = None if photo is None else np.where(photo.valid, photo.points[..., 2], np.inf)
    masks = people.masks
    camera = observations.intrinsics.matrix
    first = model.coarse.ids.numpy()[0]
    vertex = np.full((len(masks), 2 * _PAIRS), first, np.int64)
    normal = np.zeros((*vertex.shape, 2))
    offset = np.zeros(vertex.shape)
    weight = np.zeros_like(offset)
    for i, mask in enumerate(masks):
        size = float(observations.size[i])
        if not _is_usable_mask(mask, observations.points[i], observations.confidence[i], size):
            continue
        both = mask, np.asarray(np.delete(masks, i, 0).any(0))
        lines = _person_pairs(model, _crop(model, vertices[i], both, depth, camera, size))
        if lines is None:
            continue
        normal[i] = lines.normal
        weight[i] = lines.weight
        vertex[i] = np.where(weight[i] > 0, lines.vertex, first)
        # Vertices lie beside the outline, at an offset that stays constant.
        offset_px = lines.point - _project(vertices[i][vertex[i]], camera)
        offset[i] = lines.offset - (normal[i] * offset_px).sum(-1)
    loss_points, rows = np.unique(vertex, return_inverse=True)
    return OutlinePairs(
        *map(torch.from_numpy, (loss_points, rows.reshape(vertex.shape), normal, offset, weight))
    )


def _is_usable_mask(
    mask: BoolArray, points: FloatArray, confidence: FloatArray, size: float
) -> bool:
    """Return whether a mask (H, W) holds the confident keypoints (J, 2) px of its person."""
    seen = points[confidence > SURE_CONFIDENCE]
    if not mask.any() or not len(seen):
        return False
    column, row = np.clip(np.round(seen).astype(int), 0, np.array(mask.shape)[::-1] - 1).T
    beside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    return bool((beside[row, column] < _CLOSE * size).mean() >= _FEWEST_SEEN)


def _is_finger(model: BodyModel) -> BoolArray:
    """Return which vertices (V,) belong to fingers.

    These do not pair, because the fit leaves fingers at rest.
    """
    fingers = [
        row for row, name in enumerate(JOINT_NAMES) if any(part in name for part in _FINGERS)
    ]
    return np.isin(model.skin.weights.argmax(0).numpy(), fingers)


def _project(points: FloatArray, camera: FloatArray) -> FloatArray:
    """Project points (n, 3) to px (n, 2)."""
    pixels = points @ camera.T
    return pixels[..., :2] / np.maximum(pixels[..., 2:], 0.1)


@dataclass(frozen=True)
class _Crop:
    """One person in a small picture (h, w) whose pixel ``p`` shows the photo's pixel ``p / scale +
    low``.

    Attributes:
        mask: of the person.
        others: masks of the others.
        border: pixels at the border of the photo or outside.
        depth: relative, inf where unknown; None without a depth.
        vertex: (h, w) of the nearest face of the fitted body, -1 beside it.
        low: (2,) px.
        scale: px of the crop per px.
        size: of the person, px.
    """

    mask: BoolArray
    others: BoolArray
    border: BoolArray
    depth: FloatArray | None
    vertex: Int64Array
    low: FloatArray
    scale: float
    size: float

    def in_photo(self, points: FloatArray) -> FloatArray:
        """Convert px of the crop to px."""
        return points / self.scale + self.low


@dataclass(frozen=True)
class _PointPairs:
    """Pairs of one person: points (P, 2) px of the body's outline, vertices (P,) near them, and
    lines as in :class:`OutlinePairs`.
    """

    point: FloatArray
    vertex: Int64Array
    normal: FloatArray
    offset: FloatArray
    weight: FloatArray


def _person_pairs(model: BodyModel, crop: _Crop) -> _PointPairs | None:
    """Return the pairs of one person at coarse vertices, or None if mask or body is not there."""
    mask = _mask_outline(crop.mask)
    body = _mask_outline(crop.vertex >= 0)
    if mask is None or body is None:
        return None
    both = (
        _pairs_outside_body(crop, mask.spaced(), body),
        _pairs_outside_mask(crop, mask, body.spaced()),
    )
    lines = _PointPairs(
        *(
            np.concatenate([getattr(each, part.name) for each in both])
            for part in fields(_PointPairs)
        )
    )
    coarse = model.coarse.ids.numpy()[model.coarse.of_vertex.numpy()[lines.vertex]]
    return replace(lines, vertex=coarse, weight=lines.weight * ~_is_finger(model)[lines.vertex])


def _crop(
    model: BodyModel,
    vertices: FloatArray,
    masks: tuple[BoolArray, BoolArray],
    depth: FloatArray | None,
    camera: FloatArray,
    size: float,
) -> _Crop:
    """Draw a body (V, 3) and cut out its masks, of the person and of all others."""
    person_mask, others = masks
    pixels = _project(vertices, camera)
    low, high = _crop_corners(pixels, person_mask)
    scale = _CROP_SIDE / float((high - low).max())
    width, height = np.maximum(np.ceil((high - low) * scale).astype(int) + 1, 2).tolist()
    to_crop = np.array([[scale, 0, -scale * low[0]], [0, scale, -scale * low[1]]])

    def cut(picture: FloatArray, outside: float, how: int) -> FloatArray:
        return np.asarray(
            cv2.warpAffine(picture, to_crop, (width, height), flags=how, borderValue=outside)
        )

    face = rasterize(
        torch.from_numpy((pixels - low) * scale)[None].float(),
        torch.from_numpy(vertices[None, :, 2]).float(),
        model.faces,
        height,
        width,
    )[0].numpy()
    return _Crop(
        mask=cut(person_mask.astype(np.float32), 0, cv2.INTER_LINEAR) > 0.5,
        others=cut(others.astype(np.float32), 0, cv2.INTER_LINEAR) > 0.3,
        border=_dilated(cut(np.ones(person_mask.shape, np.float32), 0, cv2.INTER_NEAREST) < 0.5, 2),
        depth=None if depth is None else cut(depth.astype(np.float32), np.inf, cv2.INTER_NEAREST),
        vertex=np.where(face < 0, -1, model.faces.numpy()[face, 0]),
        low=low,
        scale=scale,
        size=size,
    )


def _crop_corners(pixels: FloatArray, mask: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest corner (2,) px of a crop around pixels (V, 2) of a body and
    its mask, up to half a photo outside the photo.
    """
    rows, columns = np.nonzero(mask)
    limits = np.array([mask.shape[1], mask.shape[0]], float)
    low = np.maximum(np.minimum(pixels.min(0), [columns.min(), rows.min()]) - 2, -0.5 * limits)
    high = np.minimum(np.maximum(pixels.max(0), [columns.max(), rows.max()]) + 2, 1.5 * limits)
    return low, high


def _pairs_outside_body(crop: _Crop, mask: _Outline, body: _Outline) -> _PointPairs:
    """Pair points of the mask that lie outside the body with the nearest point of the body's
    outline.
    """
    gap, near = cKDTree(body.points).query(mask.points)
    at = _pixel_indices(mask.points)
    weight = (
        (crop.vertex[at] < 0)
        & ((mask.normals * body.normals[near]).sum(-1) > _SAME_DIRECTION)
        & ~_dilated(crop.others, 3)[at]
        & ~crop.border[at]
        & (gap < _REACH * crop.size * crop.scale)
    )
    return _point_pairs(crop, body.points[near], mask.points, -mask.normals, weight, _CLOTHES)


def _pairs_outside_mask(crop: _Crop, mask: _Outline, body: _Outline) -> _PointPairs:
    """Pair points of the body that lie outside the mask, and that nothing hides, with the nearest
    point of the mask.
    """
    gap, near = cKDTree(mask.points).query(body.points)
    at = _pixel_indices(body.points)
    weight = (
        ~crop.mask[at]
        & ~_dilated(crop.others, 1)[at]
        & ~crop.border[at]
        & ~_hidden(crop, body.points, (mask.points - 2 * mask.normals)[near])
        & (gap < _REACH * crop.size * crop.scale)
    )
    normal = (body.points - mask.points[near]) / np.maximum(gap, 1e-6)[:, None]
    return _point_pairs(crop, body.points, mask.points[near], normal, weight, _RIM)


def _point_pairs(
    crop: _Crop,
    body: FloatArray,
    mask: FloatArray,
    normal: FloatArray,
    weight: BoolArray,
    margin: float,
) -> _PointPairs:
    """Return the pairs of points (P, 2) px of the crop on body and mask, by normals (P, 2) and a
    margin in sizes of the person.
    """
    return _PointPairs(
        crop.in_photo(body),
        crop.vertex[_pixel_indices(body)],
        normal / crop.size,
        (crop.in_photo(mask) * normal).sum(-1) / crop.size + margin,
        weight.astype(float),
    )


def _hidden(crop: _Crop, points: FloatArray, person: FloatArray) -> BoolArray:
    """Return whether the photo is nearer at points (n, 2) than at points of the person (n, 2); true
    if unknown.
    """
    if crop.depth is None:
        return np.ones(len(points), bool)
    limits = np.array(crop.mask.shape)[::-1] - 1
    own = crop.depth[_pixel_indices(np.clip(person, 0, limits))]
    seen = crop.depth[crop.mask & np.isfinite(crop.depth)]
    own = np.where(np.isfinite(own), own, np.median(seen) if len(seen) else np.inf)
    return crop.depth[_pixel_indices(points)] < _NEARER * own


def _pixel_indices(points: FloatArray) -> tuple[Int64Array, Int64Array]:
    """Return rows and columns of the pixels of points (n, 2)."""
    column, row = np.round(points).astype(int).T
    return row, column


def _dilated(mask: BoolArray, reach: int) -> BoolArray:
    """Return a mask grown by a number of px."""
    return np.asarray(
        cv2.dilate(mask.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    )


def _mask_outline(mask: BoolArray) -> _Outline | None:
    """Return the pixels on the outer outlines of a mask (H, W), or None if it is empty."""
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not lines:
        return None
    points = np.concatenate([line[:, 0] for line in lines]).astype(float)
    smooth = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2)
    slope = np.stack([cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)], -1)
    column, row = points.astype(int).T
    normals = -slope[row, column].astype(float)
    return _Outline(points, normals / (np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-9))


def without_legs(model: BodyModel, pairs: OutlinePairs, people: BoolArray) -> OutlinePairs:
    """Return pairs without those on the legs of some people, (N,) bool: a mask does not show where
    hidden legs end.
    """
    legs = torch.tensor([name.endswith(("_leg", "_foot")) for name in model.part_names])
    on_leg = legs[model.part_of_vertex[pairs.vertex_ids]][pairs.vertex]
    hidden = on_leg & torch.from_numpy(people)[:, None]
    return replace(pairs, weight=torch.where(hidden, 0.0, pairs.weight))
