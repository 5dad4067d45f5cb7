"""The body fit follows people's masks, where these can be right."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import torch

from physic_core.geometry.camera import pixel_rays
from physic_core.geometry.raster import rasterize
from physic_core.types import Pointmap

from .test_bodies import (
    CAMERA,
    FLOOR,
    IMAGE,
    MODEL,
    PLACES,
    STANDS,
    WALKS,
    fit,
    pixels_of,
    posed,
    truth,
)


def silhouette(vertices):
    """Pixels (H, W) bool of a body (V, 3)."""
    pixels, z = (torch.tensor(one[None]).float() for one in (pixels_of(vertices), vertices[:, 2]))
    return rasterize(pixels, z, MODEL.faces, *IMAGE.shape[:2])[0].numpy() >= 0


def with_masks(seen, *masks):
    return replace(seen, people=replace(seen.people, masks=np.stack(masks)))


def depth_of(seen, nearer=None):
    """A wall at 6 m behind people at their own depth, and something at 1 m at the pixels
    ``nearer``.
    """
    z = np.full(IMAGE.shape[:2], 6.0)
    for mask, body in zip(seen.people.masks, seen.vertices, strict=True):
        z[mask] = body[:, 2].mean()
    if nearer is not None:
        z[nearer] = 1.0
    rays = pixel_rays(*z.shape, torch.tensor(CAMERA.matrix)).numpy()
    points = rays * z[..., None]
    return Pointmap(points, np.ones(z.shape, bool), "scale")


def fitted(seen, depth=None):
    return posed(fit(seen, FLOOR, photo=depth))[1]


def overlap(vertices, mask):
    body = silhouette(vertices)
    return float((body & mask).sum() / (body | mask).sum())


def test_a_wider_mask_widens_the_body():
    seen = truth([STANDS], [(-0.2, 0.2, 3.0)], yaw_deg=0)
    mask = cv2.dilate(silhouette(seen.vertices[0]).astype(np.uint8), np.ones((5, 31))) > 0
    seen = with_masks(seen, mask)
    without = fitted(with_masks(seen, np.zeros_like(mask)))[0]
    drawn = fitted(seen)[0]
    assert overlap(drawn, mask) > overlap(without, mask) + 0.02


def test_a_body_that_fills_its_mask_stays():
    seen = truth([STANDS, WALKS], PLACES[:2])
    without = fitted(seen)
    seen = with_masks(seen, *(silhouette(body) for body in without))
    np.testing.assert_allclose(fitted(seen, depth_of(seen)), without, rtol=0, atol=1e-4)


def test_a_mask_without_the_persons_keypoints_is_not_used():
    seen = truth([STANDS], PLACES[:1])
    without = fitted(seen)
    half = silhouette(seen.vertices[0])
    half[: int(np.median(np.nonzero(half)[0]))] = False  # the legs alone
    np.testing.assert_array_equal(fitted(with_masks(seen, half), depth_of(seen)), without)


def test_a_body_hidden_by_something_nearer_is_not_drawn_into_its_mask():
    seen = truth([STANDS], PLACES[:1])
    without = fitted(seen)
    mask = silhouette(without[0])
    hidden = np.zeros_like(mask)
    low = np.nonzero(mask)[1].min()
    high = np.nonzero(mask)[1].max()
    hidden[:, : int(low + 0.3 * (high - low))] = True  # a pillar in front of one side
    seen = with_masks(seen, mask & ~hidden)
    with_pillar = fitted(seen, depth_of(seen, hidden))
    without_pillar = fitted(seen, depth_of(seen))
    np.testing.assert_allclose(with_pillar, without, rtol=0, atol=2e-3)
    assert np.abs(without_pillar - without).max() > 4e-3
