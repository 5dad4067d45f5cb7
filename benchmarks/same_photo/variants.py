"""Variants of a photo, and the results of variants as results of the photo: mirrored back, in its
pixels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physic_core.types import MARKS, is_usable
from physic_core.types.skeletons import other_side

if TYPE_CHECKING:
    from types import SimpleNamespace

    from physic_core import Intrinsics, Reconstruction

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

GRID = 256
"""Points of the photo, along each side, at which masks and depths are compared."""


@dataclass(frozen=True)
class Variant:
    """A change of a photo that leaves people and scene as they are.

    Attributes:
        name: in the table and of its files.
        mirrored: left and right are exchanged.
        scale: of the sides.
        margin: share of the width cut at the left and at the right, and of the height at the top
            and at the bottom.
        columns: pixels cut at the right.
        quality: of JPEG; None for no compression.
        grey: without colours.
        camera_is_known: the camera is given: that of the photo's own result, shifted by the crop.
    """

    name: str
    mirrored: bool = False
    scale: float = 1.0
    margin: float = 0.0
    columns: int = 0
    quality: int | None = None
    grey: bool = False
    camera_is_known: bool = False

    def window(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Return the part of a photo that the variant shows: left, top, right and bottom, px."""
        x = round(self.margin * width)
        y = round(self.margin * height)
        return x, y, width - x - self.columns, height - y

    def picture(self, photo: Picture) -> Picture:
        """Return the variant of a photo (H, W, 3) RGB."""
        import cv2

        left, top, right, bottom = self.window(photo.shape[1], photo.shape[0])
        found = photo[top:bottom, left:right]
        if self.mirrored:
            found = found[:, ::-1]
        if self.scale != 1:
            size = round(self.scale * found.shape[1]), round(self.scale * found.shape[0])
            found = cv2.resize(found, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        if self.grey:
            found = np.repeat(cv2.cvtColor(found, cv2.COLOR_RGB2GRAY)[..., None], 3, -1).astype(
                np.uint8
            )
        if self.quality is not None:
            data = cv2.imencode(".jpg", found[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality])[
                1
            ]
            found = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].astype(np.uint8)
        return np.ascontiguousarray(found)

    def camera(self, camera: Intrinsics) -> Intrinsics:
        """Return the camera of the variant of a photo with a camera."""
        left, top, right, bottom = self.window(camera.width, camera.height)
        width = right - left
        height = bottom - top
        found = replace(camera, cx=camera.cx - left, cy=camera.cy - top, width=width, height=height)
        if self.mirrored:
            found = replace(found, cx=width - 1 - found.cx)
        return found.resized(round(self.scale * width), round(self.scale * height))


PHOTO = Variant("photo")
VARIANTS = (
    Variant("mirror", mirrored=True),
    Variant("scale", scale=0.9),
    Variant("crop2", margin=0.02),
    Variant("crop2, K", margin=0.02, camera_is_known=True),
    Variant("crop8", margin=0.08),
    Variant("crop8, K", margin=0.08, camera_is_known=True),
    Variant("column", columns=1),
    Variant("column, K", columns=1, camera_is_known=True),
    Variant("mirror, K", mirrored=True, camera_is_known=True),
    Variant("scale, K", scale=0.9, camera_is_known=True),
    Variant("jpeg", quality=75),
    Variant("grey", grey=True),
)


@dataclass(frozen=True)
class SeenPerson:
    """A person of an answer.

    Attributes:
        mask: (GRID, GRID) bool, at the points of the photo.
        distance: from the camera to the pelvis, m; NaN without a body.
        parts: body part -> probability that it touches the world.
        usable: marks of the person that are usable.
        trust: probability that the person is right; None without checks.
    """

    mask: NDArray[np.bool_]
    distance: float
    parts: Mapping[str, float]
    usable: tuple[str, ...]
    trust: float | None


@dataclass(frozen=True)
class Answer:
    """What a result says of its photo, wherever the variant shows it.

    Attributes:
        inside: (GRID, GRID) bool, points of the photo that the variant shows.
        depth: (GRID, GRID) float32 m of the scene, NaN where unknown.
        people: of the result.
        focal: px of the photo.
        distance_sigma: standard deviation of the logarithm of all distances; None if not stated.
    """

    inside: NDArray[np.bool_]
    depth: NDArray[np.float32]
    people: tuple[SeenPerson, ...]
    focal: float
    distance_sigma: float | None


def answer_of(result: Reconstruction, variant: Variant, width: int, height: int) -> Answer:
    """Return the result of a variant of a photo of ``width`` x ``height`` px as an answer to the
    photo.
    """
    left, _, right, _ = variant.window(width, height)
    rows, columns, inside = _grid(variant, width, height)

    def sampled(values: NDArray[Any]) -> NDArray[Any]:
        places = ((rows, values.shape[0]), (columns, values.shape[1]))
        return values[np.ix_(*(np.clip((share * n).astype(int), 0, n - 1) for share, n in places))]

    people = []
    for person in result.people:
        parts = {
            other_side(p) if variant.mirrored else p: v
            for p, v in (person.world_contact or {}).items()
        }
        people.append(
            SeenPerson(
                mask=sampled(person.mask) & inside,
                distance=float(np.linalg.norm(person.joints[0])),
                parts=parts,
                usable=tuple(m for m in MARKS if is_usable(getattr(person, f"trust_{m}"))),
                trust=person.trust,
            )
        )
    scene = result.scene
    camera = result.intrinsics
    depth = sampled(np.where(scene.valid, scene.points[..., 2], np.nan))
    return Answer(
        inside=inside,
        depth=np.where(inside, depth, np.nan).astype(np.float32),
        people=tuple(people),
        focal=camera.fx * (right - left) / camera.width,
        distance_sigma=result.distance_sigma,
    )


def seen(answer: SimpleNamespace, variant: Variant, width: int, height: int) -> Answer:
    """Return what a build answers to a variant; an error shows nobody and no scene."""
    if not answer.error:
        return answer_of(answer, variant, width, height)  # type: ignore[arg-type]
    inside = _grid(variant, width, height)[2]
    return Answer(inside, np.full((GRID, GRID), np.nan, np.float32), (), math.nan, None)


def _grid(variant: Variant, width: int, height: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the rows and the columns of the points in the variant, as shares of its sides, and
    which are inside.
    """
    left, top, right, bottom = variant.window(width, height)
    shares = (np.arange(GRID) + 0.5) / GRID
    y = (shares * height - top) / (bottom - top)
    x = (shares * width - left) / (right - left)
    inside = ((y >= 0) & (y < 1))[:, None] & ((x >= 0) & (x < 1))
    return y, 1 - x if variant.mirrored else x, inside
