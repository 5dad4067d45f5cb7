"""Check that a backend interprets images as RGB."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError, PhysicError
from physic_testing.conformance.accuracy import MAIN_ERROR, main_error
from physic_testing.conformance.check import Check
from physic_testing.conformance.contract import case_violations
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.requests import infer_arguments

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

_NEGLIGIBLE_ERROR = 0.03  # an error below this is none to worry about


def check_reads_images_as_rgb(subject: BackendUnderTest) -> None:
    """The output for the photo in RGB is not less accurate than for the same photo in BGR."""
    case = subject.case("one person")
    try:
        own = main_error(subject.interface, subject.result(), case)
    except BodyModelError as error:
        raise CheckSkipped(
            "its keypoints are not defined on a body, so there is no error to compare"
        ) from error
    if own < _NEGLIGIBLE_ERROR:
        return
    image, *rest = infer_arguments(subject.interface, case)
    exchanged = (np.ascontiguousarray(image[..., ::-1]), *rest)
    try:
        answer = subject.infer(subject.loaded(case), case, exchanged)
    except PhysicError as error:
        raise CheckSkipped(
            "it raises a PhysicError for a photo with red and blue exchanged"
        ) from error
    if case_violations(subject.interface, answer, case):
        return
    other = main_error(subject.interface, answer, case)
    name = MAIN_ERROR[subject.interface]
    expect(
        other > 0.5 * own,
        "the smaller error for the photo in RGB order",
        f"an error ({name}) of {own:.3f}, but of {other:.3f} for the photo with red and blue "
        f"exchanged",
        "Does it convert the image to BGR, as OpenCV reads files? Images are RGB.",
    )


CHECKS: tuple[Check, ...] = (Check(check_reads_images_as_rgb, "physic_core.interfaces"),)
"""Colour check of interfaces whose backends process the whole photo."""
