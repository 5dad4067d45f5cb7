"""How outputs of an Inpainter are compared: the hole shows the background in RGB, and nothing else
is changed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.readings import Group, Reading, Table, flipped, shifted, times

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

_SOFT_PX = 6  # width of a soft border


def _values(answer: UInt8Array, case: Case) -> tuple[Values, Truth]:
    return {"picture": answer.astype(float)}, {"picture": case.empty.astype(float)}


def _fill(picture: FloatArray, truth: Truth) -> list[FloatArray]:
    return [picture[truth["case"].hole].ravel()]


def _slopes(picture: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the slopes of grey inside of the hole; slopes of single pixels are those of
    textures.
    """
    import cv2

    inside = cv2.erode(truth["case"].hole.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    smooth = cv2.GaussianBlur(picture.mean(axis=2), (0, 0), 1.2)
    grey = np.where(inside, smooth, np.nan)
    return [np.concatenate([np.diff(grey, axis=axis).ravel() for axis in (0, 1)])]


def _with_rim(picture: FloatArray, truth: Truth) -> FloatArray:
    """Return the fill with a border of the people's pixels left."""
    import cv2

    person = truth["case"].people.masks.any(axis=0).astype(np.uint8)
    rim = (person > 0) & (cv2.distanceTransform(person, cv2.DIST_C, 3) <= 1)
    return np.where(rim[..., None], truth["case"].photo, picture)


def _faded_in(picture: FloatArray, truth: Truth) -> FloatArray:
    """Return the fill blended with the photo near the border of the mask."""
    import cv2

    inside = cv2.distanceTransform(truth["case"].hole.astype(np.uint8), cv2.DIST_L2, 3)
    share = np.minimum(inside / _SOFT_PX, 1)[..., None]
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


def check_an_empty_mask_changes_nothing(subject: BackendUnderTest) -> None:
    """With an empty mask, the output equals the input; with a full one, it is valid or refused with
    a PhysicError.
    """
    case, request = subject.valid_request()
    full = replace(request, mask=np.ones_like(case.hole))
    subject.call("an image for a full mask", case, full, may_refuse=True)
    empty = replace(subject.request(case), mask=np.zeros_like(case.hole))
    answer = subject.call("an image for an empty mask", case, empty)
    expect(np.array_equal(answer, case.photo), "the photo for an empty mask", "another image")


_COARSE = "Is it resized from a small input? Fill at the size of the photo, or in tiles of it."
_RANGE = "Is the value range right, and are mean and standard deviation undone?"
_RIM = "Is the mask shrunk, or blended with the photo at its border?"
_BGR = "OpenCV reads and writes BGR; images here are RGB."
_FLIP = "Was the photo mirrored or turned for the network?"

_COLOURS = (
    Reading("of red and blue exchanged", flipped(2), _BGR),
    Reading("without color", lambda p, _: p.mean(axis=2, keepdims=True) * [1, 1, 1], _RANGE),
    Reading("mirrored", flipped(1), _FLIP),
    Reading("brighter", times(1.2), _RANGE, 20, " %", 5),
    Reading("of the photo", lambda _, truth: truth["case"].photo, _RIM, 100, " %", 30),
    # A fill from what is around is smooth, too, but another picture.
    Reading("of a sixteenth of the size", _coarse, _COARSE, left=0.5),
    Reading("the photo at the border of people", _with_rim, _RIM),
    Reading("blended with the photo near the border of the mask", _faded_in, _RIM, limit=0.75),
)

_RESIZED = "Is it resized or padded?"

_PLACE = (
    Reading("to the right", shifted(1), _RESIZED, 1, " px", 0.5),
    Reading("down", shifted(0), _RESIZED, 1, " px", 0.5),
)

TABLE = Table(
    _values,
    (
        Check(check_only_the_mask_is_filled),
        Check(check_an_empty_mask_changes_nothing, after=("only_the_mask_is_filled",)),
    ),
    (
        Group(
            "fill_has_the_colours_around",
            "the colors of the background in RGB order",
            "picture",
            "gray levels",
            _COLOURS,
            _fill,
            after=("only_the_mask_is_filled",),
        ),
        Group(
            "fill_is_not_shifted",
            "a fill in place",
            "picture",
            "gray levels",
            _PLACE,
            _slopes,
            after=("fill_has_the_colours_around",),
        ),
    ),
)
