"""Checks of the output of every backend: valid for all kinds of photos, deterministic, and without
side effects.
"""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import ConfigError
from physic_testing.conformance.backend_under_test import FIRST_PHOTO
from physic_testing.conformance.cases import CASES
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.field_comparison import describe_difference
from physic_testing.conformance.requests import infer_arguments, read_only_views

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest, CaseRun

_BUFFER = "Does it return the same buffer in every call?"


def check_returns_valid_output(subject: BackendUnderTest) -> None:
    """For a standard photo of one person, the output has valid types, shapes, dtypes and value
    ranges.
    """
    _expect_valid_output(subject, "one person")


def check_accepts_several_people(subject: BackendUnderTest) -> None:
    """For a photo of several people, the output is valid."""
    hint = (
        "Are masks inverted, or those of whole people? True marks the pixels in which a person "
        "is visible."
    )
    _expect_valid_output(
        subject, "several people", hint if subject.interface == "segmenter" else ""
    )


def check_accepts_or_refuses_each_photo_of_people(subject: BackendUnderTest) -> None:
    """For each photo over which bias is measured, the output is valid or infer raises a
    PhysicError.
    """
    for name in subject.evidence_names:
        has_sky = name == "steps" and subject.interface in ("metric_depth", "relative_pointmap")
        hint = "Is it the sky, whose depth is NaN and not 0?" if has_sky else ""
        _expect_valid_output_or_refusal(subject, name, hint)


def check_accepts_an_odd_size(subject: BackendUnderTest) -> None:
    """For a photo of 131 x 97 px, which is not a multiple of a patch size, the output is valid."""
    _expect_valid_output(
        subject,
        "odd size",
        "Does it pad or crop to a multiple of 14, 16 or 32, and not resize the output back?",
    )


def check_accepts_a_portrait(subject: BackendUnderTest) -> None:
    """For a photo in portrait format, the output is valid."""
    _expect_valid_output(subject, "walking", "Does it mix up width and height?")


def check_accepts_a_photo_without_people(subject: BackendUnderTest) -> None:
    """For a photo without people, the output has N = 0 rows. None or an error is wrong."""
    _expect_valid_output(subject, "nobody", "Return arrays of 0 rows for 0 people.")


def check_accepts_or_refuses_a_blank_photo(subject: BackendUnderTest) -> None:
    """For a uniformly grey photo, the output is valid or infer raises a PhysicError."""
    _expect_valid_output_or_refusal(
        subject, "blank", "Does it divide by a range or a deviation that is 0?"
    )


def check_accepts_or_refuses_a_tiny_photo(subject: BackendUnderTest) -> None:
    """For a photo of 32 x 24 px, the output is valid or infer raises a PhysicError."""
    _expect_valid_output_or_refusal(subject, "tiny", "Does it round a size down to 0?")


def check_accepts_or_refuses_a_large_photo(subject: BackendUnderTest) -> None:
    """For a photo of four times the width and height, the output is valid or infer raises a
    PhysicError.
    """
    _expect_valid_output_or_refusal(
        subject, "large", "Does it assume the input size of its network?"
    )


def check_does_not_modify_its_input(subject: BackendUnderTest) -> None:
    """infer does not modify its arguments: it copies an array before it writes to it."""
    subject.result()
    edited = {
        name: attempt.changed_arguments
        for name, attempt in subject.case_runs.items()
        if attempt.changed_arguments
    }
    places = sorted({place for found in edited.values() for place in found})
    expect(
        not edited,
        "photo, people, keypoints and hints as they were before infer()",
        f"other values in {', '.join(places)} (photo '{next(iter(edited), '')}')",
        "Copy before you write: `image.copy()`, `a = a + 1` in place of `a += 1`.",
    )


def check_accepts_array_views(subject: BackendUnderTest) -> None:
    """infer accepts read-only arrays with negative strides, which photos rotated by EXIF data
    have.
    """
    first = subject.result("odd size")
    case = subject.case("odd size")
    answer = subject.call(
        "valid output for read-only arrays with negative strides",
        case,
        read_only_views(infer_arguments(subject.interface, case)),
        "Call np.ascontiguousarray(array) before torch.from_numpy; copy before writing.",
    )
    if "stochastic" not in subject.capabilities:
        changes = describe_difference(first, answer)
        expect(not changes, "the same output for a view of the same photo", changes)


def check_is_deterministic(subject: BackendUnderTest) -> None:
    """Two instances with the same options return the same output for the same photo."""
    changes = _change_by_a_new_instance(subject)
    if changes and not describe_difference(
        _of_new_instance(subject), _of_new_instance.__wrapped__(subject)
    ):
        return  # new instances agree: 'does_not_repeat_itself' says what is wrong
    expect(
        not changes,
        "the same output from a second backend with the same options",
        changes,
        "Seed every random generator from an option, or declare the capability 'stochastic'.",
    )


def check_does_not_repeat_itself(subject: BackendUnderTest) -> None:
    """The output for a photo is not that of an earlier photo of the same size."""
    changes = _change_by_a_new_instance(subject)
    earlier, later = subject.photos_of_one_size
    expect(
        not changes,
        f"the output of a new instance for the photo '{later}', after a call on '{earlier}' of "
        f"the same size",
        changes,
        "Is a result, a camera or a buffer kept by the size of the photo, or from the call before?",
    )


def _change_by_a_new_instance(subject: BackendUnderTest) -> str:
    """Describe how a new instance's output for the second of two photos of one size differs; empty
    if it does not.
    """
    earlier, later = subject.photos_of_one_size
    subject.result(earlier)
    return describe_difference(subject.result(later), _of_new_instance(subject))


@lru_cache(maxsize=1)
def _of_new_instance(subject: BackendUnderTest) -> Any:
    """Return the output of a new instance for the second of two photos of one size."""
    case = subject.case(subject.photos_of_one_size[1])
    backend = subject.construct(case)
    try:
        backend.load(subject.device)
        return subject.infer(backend, case)
    finally:
        with suppress(Exception):  # reported by 'load_and_close_may_be_repeated'
            backend.close()


def check_keeps_no_state_between_photos(subject: BackendUnderTest) -> None:
    """The output for a photo does not depend on earlier calls, and later calls do not modify it."""
    first = subject.result(FIRST_PHOTO)
    case = subject.case(FIRST_PHOTO)
    for name in ("one person", "blank"):
        subject.run_case(name)
    for name, attempt in subject.case_runs.items():
        changes = describe_difference(attempt.result, attempt.shared_result)
        expect(
            not changes,
            f"the output for the photo '{name}' to stay unchanged",
            f"a later call changed it: {changes}",
            _BUFFER,
        )
    again = subject.call(
        "output for the same photo in a second call", case, infer_arguments(subject.interface, case)
    )
    changes = describe_difference(first, again)
    expect(
        not changes,
        "the same output for the same photo after calls on others",
        changes,
        "Does it keep a running average or a counter?",
    )


def check_works_without_hints(subject: BackendUnderTest) -> None:
    """Without hints, the output is valid or infer raises a PhysicError."""
    from physic_core.types import Hints

    subject.result()
    case = subject.case("one person")
    arguments = tuple(
        Hints() if isinstance(a, Hints) else a for a in infer_arguments(subject.interface, case)
    )
    wanted = (
        "valid output for Hints(), in which everything is None, or a PhysicError that names "
        "the missing hint"
    )
    subject.call(wanted, case, arguments, may_refuse=True)


def check_ignores_the_image(subject: BackendUnderTest) -> None:
    """The output for a grey photo is the same, as the capability "ignores_image" declares."""
    first = subject.result()
    case = subject.case("one person")
    image, *rest = infer_arguments(subject.interface, case)
    changes = describe_difference(
        first, subject.infer(subject.loaded(case), case, (np.full_like(image, 128), *rest))
    )
    expect(
        not changes,
        "the same output for an image all grey, as the capability 'ignores_image' declares",
        changes,
        "Remove 'ignores_image' from `capabilities`: the checks of bias then run.",
    )


def _expect_valid_output(subject: BackendUnderTest, name: str, hint: str = "") -> None:
    """Raise CheckFailed unless the backend returned valid output for a photo."""
    attempt = _attempt(subject, name)
    case = subject.case(name)
    if name != "nobody" and _lacks_rows(attempt) and _lacks_rows(subject.run_case("nobody")):
        raise CheckSkipped("see 'accepts_a_photo_without_people'")
    wanted = f"valid output for a photo of {case.size}, {CASES[name]}"
    if isinstance(attempt.error, ConfigError):
        raise CheckSkipped(f"not ready: {attempt.error}")
    if attempt.error is not None:
        raise CheckFailed(
            wanted, describe_error(attempt.error, subject.kind), hint
        ) from attempt.error
    expect(not attempt.violations, wanted, "; ".join(attempt.violations), hint)


def _expect_valid_output_or_refusal(subject: BackendUnderTest, name: str, hint: str) -> None:
    """Raise CheckFailed unless the backend returned valid output or raised a PhysicError."""
    attempt = _attempt(subject, name)
    if not attempt.refused:
        _expect_valid_output(
            subject,
            name,
            f"{hint} Raise a PhysicError for a photo that cannot be processed.".strip(),
        )


def _attempt(subject: BackendUnderTest, name: str) -> CaseRun:
    """Call the backend on a photo; skip if it returned no valid output for the photo of one
    person.
    """
    if name != "one person":
        subject.result("one person")
    return subject.run_case(name)


def _lacks_rows(attempt: CaseRun) -> bool:
    """Return whether an output is invalid only because its arrays for 0 people have another shape
    than (0, ...).
    """
    return bool(attempt.violations) and all(
        "must be (0, " in violation for violation in attempt.violations
    )


_TYPES = "physic_core.types"
_BACKEND = "physic_core.interfaces"
_ALONE = frozenset({"stochastic"})
CHECKS: tuple[Check, ...] = (
    Check(check_returns_valid_output, _TYPES, after=("class_fits_its_interface",)),
    Check(check_accepts_several_people, _TYPES),
    Check(
        check_accepts_or_refuses_each_photo_of_people,
        _BACKEND,
        after=("returns_valid_output", "accepts_several_people", "accepts_a_portrait"),
    ),
    Check(check_accepts_an_odd_size, _TYPES),
    Check(check_accepts_a_portrait, _TYPES),
    Check(check_accepts_or_refuses_a_blank_photo, _BACKEND),
    Check(check_accepts_or_refuses_a_tiny_photo, _BACKEND),
    Check(check_accepts_or_refuses_a_large_photo, _BACKEND),
    Check(check_does_not_modify_its_input, _BACKEND),
    Check(check_is_deterministic, _BACKEND, unless=_ALONE),
    Check(check_does_not_repeat_itself, _BACKEND, unless=_ALONE, after=("is_deterministic",)),
    Check(
        check_keeps_no_state_between_photos, _BACKEND, unless=_ALONE, after=("is_deterministic",)
    ),
    Check(check_ignores_the_image, "physic_testing.conformance.CAPABILITIES", only_with=BLIND),
    Check(
        check_accepts_array_views,
        _BACKEND,
        after=("keeps_no_state_between_photos", "does_not_modify_its_input"),
    ),
)
"""Checks of every interface, in order of execution."""

HINT_CHECKS: tuple[Check, ...] = (Check(check_works_without_hints, "physic_core.types.Hints"),)
"""Checks of interfaces whose ``infer`` receives hints."""

PEOPLE_CHECKS: tuple[Check, ...] = (Check(check_accepts_a_photo_without_people, _TYPES),)
"""Checks of interfaces whose output has one row per person."""
