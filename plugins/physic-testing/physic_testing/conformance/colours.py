"""Check that a network is fed red, green and blue in this order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError, PhysicError
from physic_testing.conformance.accuracy import measure
from physic_testing.conformance.asking import form_faults, inputs
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

_ERRORS = {
    "segmenter": "IoU",
    "metric_depth": "abs-rel, scale fitted",
    "relative_pointmap": "abs-rel, aligned",
    "keypoint_detector": "share of person",
}
_SMALL = 0.03  # an error below this is none to worry about


def check_colours_are_taken_as_rgb(subject: Subject) -> None:
    """It is not clearly better at a photo whose red and blue are exchanged."""
    case = subject.case("one person")
    try:
        own = _error(subject.interface, measure(subject.interface, subject.answer(), case))
    except BodyModelError as error:
        raise CheckSkipped("its keypoints lie nowhere on a body: there is no error to compare") from error
    if own < _SMALL:
        return
    image, *rest = inputs(subject.interface, case)
    exchanged = (np.ascontiguousarray(image[..., ::-1]), *rest)
    try:
        answer = subject.ask(subject.loaded(case), case, exchanged)
    except PhysicError as error:
        raise CheckSkipped("it refuses a photo whose red and blue are exchanged") from error
    if form_faults(subject.interface, answer, case):
        return
    other = _error(subject.interface, measure(subject.interface, answer, case))
    name = _ERRORS[subject.interface]
    expect(
        other > 0.5 * own,
        "the best answer for a photo in the order red, green, blue",
        f"an error ({name}) of {own:.3f}, but of {other:.3f} for the photo with red and blue exchanged",
        "Does it feed its network BGR, as OpenCV reads files? Images here are RGB already.",
    )


def _error(interface: str, measured: dict[str, float]) -> float:
    value = measured[_ERRORS[interface]]
    return 1 - value if interface == "segmenter" else value


CHECKS: tuple[Check, ...] = (Check(check_colours_are_taken_as_rgb, "physic_core.interfaces"),)
"""Of interfaces whose backends read the whole picture."""
