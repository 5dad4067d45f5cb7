"""How outputs of an Inpainter are compared: the hole shows the background in RGB, and nothing else
is changed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.conformance.changes import Change
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    flipped,
    shifted,
    times,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

_SOFT_PX = 6  # width of a soft border


def _values(answer: UInt8Array, case: Case) -> tuple[Values, Truth]:
    return {"picture": answer.astype(float)}, {"picture": case.empty.astype(float)}


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    error = (values["picture"] - truth["picture"])[truth["case"].hole]
    return {"PSNR in the hole, dB": 10 * np.log10(255**2 / max((error**2).mean(), 1e-2))}


def _fill(picture: FloatArray, truth: Truth) -> list[FloatArray]:
    return [picture[truth["case"].hole].ravel()]


def _slopes(picture: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the slopes of grey inside of the hole; slopes of single pixels are those of
    textures.
    """
    import cv2

    inside = cv2.erode(truth["case"].hole.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    smooth = cv2.GaussianBlur(picture.mean(axis=2), (0, 0), 1.2)
    return [np.array(np.gradient(np.where(inside, smooth, np.nan))).ravel()]


def _depth_inside(mask: BoolArray) -> FloatArray:
    """Return the distance (H, W, 1) of each pixel of a mask from the pixels beside it, px."""
    import cv2

    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(inside)[..., None]


def _with_rim(picture: FloatArray, truth: Truth) -> FloatArray:
    """Return the fill with a border of the people's pixels left."""
    inside = _depth_inside(truth["case"].people.masks.any(axis=0))
    return np.where((inside > 0) & (inside <= 1), truth["case"].photo, picture)


def _faded_in(picture: FloatArray, truth: Truth) -> FloatArray:
    """Return the fill blended with the photo near the border of the mask."""
    share = np.minimum(_depth_inside(truth["case"].hole) / _SOFT_PX, 1)
    faded: FloatArray = share * picture + (1 - share) * truth["case"].photo
    return faded


def _coarse(picture: FloatArray, truth: Truth) -> FloatArray:
    """Return the picture as it is after it was a sixteenth as wide and high."""
    import cv2

    height, width = picture.shape[:2]
    small = cv2.resize(picture, (width // 16, height // 16), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height)))


def check_only_the_mask_is_filled(subject: BackendUnderTest) -> None:
    """Pixels where the mask is False are unchanged."""
    case = subject.case("one person")
    answer = subject.result()
    outside = int(((answer != case.photo).any(axis=2) & ~case.hole).sum())
    hint = "True marks the pixels to fill: np.where(mask[..., None], filled, image)."
    expect(not outside, "unchanged pixels where mask is False", f"{outside} changed pixels", hint)


_EMPTY_MASK = Change(
    "an_empty_mask_changes_nothing",
    "the photo for an empty mask",
    lambda request, _: replace(request, mask=np.zeros_like(request.mask)),
    lambda _, case: case.photo,
).as_check(after=("only_the_mask_is_filled",))

_COARSE = "Is it resized from a small input? Fill at the size of the photo, or in tiles of it."
_RANGE = "Is the value range right, and are mean and standard deviation undone?"
_RIM = "Is the mask shrunk, or blended with the photo at its border?"
_BGR = "OpenCV reads and writes BGR; images here are RGB."
_RESIZED = "Is it resized or padded?"
_FLIP = "Was the photo mirrored or turned for the network?"

TABLE = Table(
    _values,
    _errors,
    (Check(check_only_the_mask_is_filled), _EMPTY_MASK),
    (
        Group(
            "fill_has_the_colours_around",
            "the colors of the background in RGB order",
            "picture",
            "gray levels",
            (
                KnownMistake("of red and blue exchanged", flipped(2), _BGR),
                KnownMistake(
                    "without color", lambda p, _: p.mean(2, keepdims=True) + [0] * 3, _RANGE
                ),
                KnownMistake("mirrored", flipped(1), _FLIP),
                KnownMistake("brighter", times(1.2), _RANGE, 20, " %", 5),
                KnownMistake(
                    "of the photo", lambda _, truth: truth["case"].photo, _RIM, 100, " %", 30
                ),
                # A fill from what is around is smooth, too, but another picture.
                KnownMistake("of a sixteenth of the size", _coarse, _COARSE, left=0.3),
                KnownMistake("the photo at the border of people", _with_rim, _RIM),
                KnownMistake(
                    "blended with the photo at the mask's border", _faded_in, _RIM, limit=0.75
                ),
            ),
            _fill,
            after=("only_the_mask_is_filled",),
            rough=60,  # a mean colour has 24
        ),
        Group(
            "fill_is_not_shifted",
            "a fill in place",
            "picture",
            "gray levels",
            (
                KnownMistake("to the right", shifted(1), _RESIZED, 1, " px", 0.5),
                KnownMistake("down", shifted(0), _RESIZED, 1, " px", 0.5),
            ),
            _slopes,
            after=("fill_has_the_colours_around",),
        ),
    ),
)
