"""How outputs of an Inpainter are compared: the hole shows the background in RGB, and nothing else
is changed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.readings import Group, Reading, Table, between, changed

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.readings import Make, Values

_VISIBLE_CHANGE = 8  # grey levels by which a pixel visibly differs
_SOFT_PX = 6  # width of a soft border


def _values(answer: UInt8Array, case: Case, truth: Values) -> Values:
    return {"picture": answer.astype(np.float64), "photo": case.photo.astype(np.float64)}


def _truth(answer: UInt8Array, case: Case) -> Values:
    return {
        "picture": case.empty.astype(np.float64),
        "photo": case.photo.astype(np.float64),
        "hole": case.hole,
    }


def _shifted(right: int, down: int) -> Make:
    return changed(picture=lambda image: np.roll(image, (down, right), (0, 1)))


def _slopes(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    """Return the slopes of grey inside of the hole; slopes of single pixels are those of
    textures.
    """
    import cv2

    inside = cv2.erode(case.hole.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    smooth = cv2.GaussianBlur(values["picture"].mean(axis=2), (0, 0), 1.2)
    grey = np.where(inside, smooth, np.nan)
    return [np.concatenate([np.diff(grey, axis=axis).ravel() for axis in (0, 1)])]


def _with_rim(values: Values, case: Case) -> Values:
    """Return the fill with a border of the people's pixels left."""
    import cv2

    person = case.people.masks.any(axis=0).astype(np.uint8)
    rim = (person > 0) & (cv2.distanceTransform(person, cv2.DIST_C, 3) <= 1)
    return values | {"picture": np.where(rim[..., None], values["photo"], values["picture"])}


def _faded_in(values: Values, case: Case) -> Values:
    """Return the fill blended with the photo near the border of the mask."""
    import cv2

    inside = cv2.distanceTransform(case.hole.astype(np.uint8), cv2.DIST_L2, 3)
    share = np.minimum(inside / _SOFT_PX, 1)[..., None]
    return values | {"picture": share * values["picture"] + (1 - share) * values["photo"]}


_RANGE = "Is the value range right, and are mean and standard deviation undone?"
_RIM = "Is the mask shrunk, or blended with the photo at its border?"
_BGR = "OpenCV reads and writes BGR; images here are RGB."
_FLIP = "Was the photo mirrored or turned for the network?"
_RESIZED = "Is it resized or padded?"


def _blended(values: Values, case: Case) -> Values:
    return values | {"picture": (values["picture"] + values["photo"]) / 2}


def _fill(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    return [np.where(case.hole[..., None], values["picture"], np.nan).ravel()]


_COLOURS = (
    Reading("of red and blue exchanged", changed(picture=lambda i: i[..., ::-1]), _BGR),
    Reading(
        "without colour",
        changed(picture=lambda i: i.mean(axis=2, keepdims=True) * [1, 1, 1]),
        _RANGE,
    ),
    Reading("mirrored", changed(picture=lambda i: i[:, ::-1]), _FLIP),
    Reading("brighter", changed(picture=lambda i: 1.2 * i), _RANGE, 20.0, " %", 5.0),
    Reading("blended with the photo", _blended, _RIM),
    Reading("the photo at the border of people", _with_rim, _RIM),
    Reading("blended with the photo near the border of the mask", _faded_in, _RIM, limit=0.75),
)
_RIGHT = between("picture", _shifted(1, 0), _shifted(-1, 0))
_DOWN = between("picture", _shifted(0, 1), _shifted(0, -1))
_PLACE = (
    Reading("to the right", _RIGHT, _RESIZED, 1.0, " px", 0.5),
    Reading("down", _DOWN, _RESIZED, 1.0, " px", 0.5),
)
_GREY = "grey levels"
_AROUND = "fill_has_the_colours_around"
_FILLED = ("only_the_mask_is_filled",)
TABLE = Table(
    _values,
    _truth,
    (
        Group(
            _AROUND,
            "the colours of the background in RGB order",
            _GREY,
            _fill,
            _COLOURS,
            after=_FILLED,
        ),
        Group("fill_is_not_shifted", "a fill in place", _GREY, _slopes, _PLACE, after=(_AROUND,)),
    ),
    "physic_core.interfaces.Inpainter",
)


def check_only_the_mask_is_filled(subject: BackendUnderTest) -> None:
    """Pixels where the mask is False are unchanged, and most others are not."""
    case = subject.case("one person")
    answer = subject.result()
    outside = int(((answer != case.photo).any(axis=2) & ~case.hole).sum())
    hint = "True marks the pixels to fill: np.where(mask[..., None], filled, image)."
    expect(not outside, "unchanged pixels where mask is False", f"{outside} changed pixels", hint)
    kept = []
    for one, filled in subject.evidence():
        person = one.truth.masks.any(axis=0)
        colours = np.abs(one.photo - one.empty.astype(int)).max(axis=2)
        telling = person & (colours > 3 * _VISIBLE_CHANGE)
        same = np.abs(filled.astype(int) - one.photo).max(axis=2) <= _VISIBLE_CHANGE
        kept.append(float(same[telling].mean()) if telling.any() else 0.0)
    expect(
        float(np.median(kept)) < 0.5,
        "other colours in most pixels of people",
        f"{np.median(kept):.0%} of them are unchanged",
        "True marks the pixels to fill: is the mask inverted, or the network's output not used?",
    )


def check_an_empty_mask_changes_nothing(subject: BackendUnderTest) -> None:
    """With an empty mask, the output equals the input; with a full one, it is valid or refused with
    a PhysicError.
    """
    subject.result()
    case = subject.case("one person")
    full = np.ones_like(case.hole)
    subject.call("an image for a full mask", case, (case.photo.copy(), full), may_refuse=True)
    answer = subject.call("an image for an empty mask", case, (case.photo.copy(), ~full))
    expect(np.array_equal(answer, case.photo), "the photo for an empty mask", "another image")


CHECKS: tuple[Check, ...] = (
    Check(check_only_the_mask_is_filled, TABLE.read),
    Check(check_an_empty_mask_changes_nothing, TABLE.read, after=("only_the_mask_is_filled",)),
)
"""Further checks of an Inpainter, in order of execution."""
