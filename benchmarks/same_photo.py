"""How much the answer to a photo changes when the photo is mirrored, scaled, cropped, compressed or
gray.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physic_testing.metrics import match_by_masks

if TYPE_CHECKING:
    from physic_core import Intrinsics

Picture = NDArray[np.uint8]

GRID = 256
"""Points of the photo, along each side, at which masks are compared."""

LARGEST = 4
"""People of a photo who count, by the area of their masks: otherwise a crowd would count more than
all other photos.
"""

LEAST_VISIBLE = 0.5
"""Share of a person that a variant must show so that the person counts."""


@dataclass(frozen=True)
class Variant:
    """A change of a photo that leaves people and scene as they are.

    Attributes:
        name: of the change.
        mirrored: left and right are exchanged.
        scale: of the sides.
        margin: share of the width cut at the left and at the right, and of the height at the top
            and at the bottom.
        columns: pixels cut at the right.
        quality: of JPEG; None for no compression.
        gray: without colors.
    """

    name: str
    mirrored: bool = False
    scale: float = 1.0
    margin: float = 0.0
    columns: int = 0
    quality: int | None = None
    gray: bool = False

    def window(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Return the part of a photo that the variant shows: left, top, right and bottom, px."""
        x = round(self.margin * width)
        y = round(self.margin * height)
        return x, y, width - x - self.columns, height - y

    def picture(self, photo: Picture) -> Picture:
        """Return the variant of a photo (H, W, 3) RGB."""
        import cv2

        left, top, right, bottom = self.window(photo.shape[1], photo.shape[0])
        changed: Any = photo[top:bottom, left:right]
        if self.mirrored:
            changed = changed[:, ::-1]
        if self.scale != 1:
            size = round(self.scale * changed.shape[1]), round(self.scale * changed.shape[0])
            changed = cv2.resize(changed, size, interpolation=cv2.INTER_AREA)
        if self.gray:
            changed = np.repeat(cv2.cvtColor(changed, cv2.COLOR_RGB2GRAY)[..., None], 3, -1)
        if self.quality is not None:
            options = [cv2.IMWRITE_JPEG_QUALITY, self.quality]
            data = cv2.imencode(".jpg", changed[..., ::-1], options)[1]
            changed = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]
        return np.ascontiguousarray(changed)

    def camera(self, camera: Intrinsics) -> Intrinsics:
        """Return the camera of the variant of a photo with a camera."""
        left, top, right, bottom = self.window(camera.width, camera.height)
        width = right - left
        height = bottom - top
        changed = replace(
            camera, cx=camera.cx - left, cy=camera.cy - top, width=width, height=height
        )
        if self.mirrored:
            changed = replace(changed, cx=width - 1 - changed.cx)
        return changed.resized(round(self.scale * width), round(self.scale * height))


PHOTO = Variant("photo")
VARIANTS = (
    Variant("mirror", mirrored=True),
    Variant("scale", scale=0.9),
    Variant("jpeg", quality=75),
    Variant("column", columns=1),
    Variant("gray", gray=True),
)


@dataclass(frozen=True)
class SeenPerson:
    """A person of an answer.

    Attributes:
        mask: (GRID, GRID) bool, at the points of the photo.
        distance: from the camera to the pelvis, m; NaN without a body.
        usable: marks of the person that are usable.
    """

    mask: NDArray[np.bool_]
    distance: float
    usable: tuple[str, ...]


@dataclass(frozen=True)
class Answer:
    """What a result says of its photo, wherever the variant shows it.

    Attributes:
        inside: (GRID, GRID) bool, points of the photo that the variant shows.
        people: of the result, the largest first.
    """

    inside: NDArray[np.bool_]
    people: tuple[SeenPerson, ...]


def answer_of(people: Sequence[Any], variant: Variant, width: int, height: int) -> Answer:
    """Return the people of a result of a variant, at the points of the photo of ``width`` x
    ``height`` px.
    """
    left, top, right, bottom = variant.window(width, height)
    shares = (np.arange(GRID) + 0.5) / GRID
    y = (shares * height - top) / (bottom - top)
    x = (shares * width - left) / (right - left)
    inside = ((y >= 0) & (y < 1))[:, None] & ((x >= 0) & (x < 1))
    sides = y, 1 - x if variant.mirrored else x

    def sampled(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        pairs = zip(sides, mask.shape, strict=True)
        places = [np.clip((share * n).astype(int), 0, n - 1) for share, n in pairs]
        return mask[np.ix_(*places)] & inside

    visible = [
        SeenPerson(
            mask=sampled(person.mask),
            distance=float(np.linalg.norm(person.joints[0])),
            usable=tuple(person.usable),
        )
        for person in people
    ]
    return Answer(inside, tuple(sorted(visible, key=lambda person: -int(person.mask.sum()))))


@dataclass(frozen=True)
class PersonChange:
    """Change of one person.

    Attributes:
        person: rank among the photo's people, the largest first.
        distance: logarithm of the ratio of the distances.
        usable: marks that are usable in both answers.
    """

    person: int
    distance: float
    usable: tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True)
class Change:
    """Change of an answer.

    Attributes:
        people: who are in both answers.
        visible: number of the photo's largest people of whom the variant shows enough.
        lost: of these, people whom the variant's answer lacks.
        new: of the variant's largest people, those whom the photo's answer lacks.
    """

    people: tuple[PersonChange, ...]
    visible: int
    lost: int
    new: int


def change(photo: Answer, variant: Answer) -> Change:
    """Compare the answer to a photo with that to its variant."""
    ours, theirs = photo.people, variant.people
    cut = [person.mask & variant.inside for person in ours]
    matches = _matched([person.mask for person in theirs], cut)
    counted = [
        i
        for i, person in enumerate(ours[:LARGEST])
        if cut[i].any() and cut[i].sum() >= LEAST_VISIBLE * person.mask.sum()
    ]
    return Change(
        people=tuple(
            PersonChange(
                i, math.log(other.distance / ours[i].distance), (ours[i].usable, other.usable)
            )
            for i in counted
            if i in matches
            for other in [theirs[matches[i]]]
        ),
        visible=len(counted),
        lost=len(set(counted) - set(matches)),
        new=len(set(range(len(theirs[:LARGEST]))) - set(matches.values())),
    )


def same_people(one: Answer, other: Answer) -> dict[int, int]:
    """Return rank -> rank of the people of two answers to the same picture."""
    return _matched(*([person.mask for person in answer.people] for answer in (other, one)))


def _matched(
    predicted: Sequence[NDArray[np.bool_]], truth: Sequence[NDArray[np.bool_]]
) -> dict[int, int]:
    masks = (np.array(some, bool).reshape(-1, GRID, GRID) for some in (predicted, truth))
    return match_by_masks(*masks).predicted_of
