"""Checks of the output of every backend: valid for all kinds of photos, and of the photo alone."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import BodyModelError, ConfigError, PhysicError
from physic_core.interfaces.comparison import describe_difference
from physic_testing.conformance.accuracy import main_error
from physic_testing.conformance.cases import CASES, FIRST_PHOTO, rows_of
from physic_testing.conformance.changes import ARRAY_VIEWS, GRAY
from physic_testing.conformance.check import SAME, Check
from physic_testing.conformance.contract import case_violations
from physic_testing.conformance.expect import (
    CheckFailed,
    CheckSkipped,
    expect,
    expect_or_warn,
    expect_same,
)

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

REQUIRED = {
    "several people": "Are masks inverted, or those of whole people?",
    "walking": "Does it mix up width and height?",
    FIRST_PHOTO: "Does it pad or crop to a multiple of 14 or 32, and not resize the output back?",
}
"""Photos for which an output is required -> likely cause of another answer."""

OPTIONAL = {
    "blank": "Does it divide by a range or a deviation that is 0?",
    "tiny": "Does it round a size down to 0?",
    "large": "Does it assume the input size of its network?",
}
"""Photos that a backend may refuse by a PhysicError, beside those over which bias is measured."""

MAX_RATIO = 0.5
"""Share of the error that rows in the right order, and colours in the right one, leave at most."""

_NEGLIGIBLE_ERROR = 0.03  # an error below this is none to worry about


def check_returns_valid_output(subject: BackendUnderTest) -> None:
    """For a standard photo of one person, the output has valid types, shapes, dtypes and value
    ranges.
    """
    _expect_valid_output(subject, "one person")


def check_accepts_photos_of_people(subject: BackendUnderTest) -> None:
    """For several people, a portrait photo and one of 131 x 97 px, the output is valid."""
    for name, hint in REQUIRED.items():
        _expect_valid_output(subject, name, hint)


def check_accepts_a_photo_without_people(subject: BackendUnderTest) -> None:
    """For a photo without people, the output has N = 0 rows. None or an error is wrong."""
    _expect_valid_output(subject, "nobody", "Return arrays of 0 rows for 0 people.")


def check_accepts_or_refuses_any_photo(subject: BackendUnderTest) -> None:
    """For a grey photo, one of 32 x 24 px, a large one and all photos over which bias is measured,
    the output is valid or infer raises a PhysicError.
    """
    subject.result()
    for name in (*OPTIONAL, *subject.evidence_names):
        if not isinstance(subject.run_case(name).error, PhysicError):
            hint = OPTIONAL.get(name, "Is it the sky, whose depth is NaN and not 0?")
            hint += " Raise a PhysicError for a photo that cannot be processed."
            _expect_valid_output(subject, name, hint)


def check_does_not_modify_its_input(subject: BackendUnderTest) -> None:
    """infer does not modify its arguments: it copies an array before it writes to it."""
    subject.result()
    edited = {path for attempt in subject.case_runs.values() for path in attempt.changed_arguments}
    expect(
        not edited,
        "photo, people, keypoints and hints as they were before infer()",
        f"other values in {', '.join(sorted(edited))}",
        "Copy before you write: `image.copy()`, `a = a + 1` in place of `a += 1`.",
    )


def check_output_depends_on_the_photo_alone(subject: BackendUnderTest) -> None:
    """The output is the same in a second call after others, and of a second instance with the same
    options.
    """
    case, request = subject.valid_request(FIRST_PHOTO)
    earlier, later = subject.evidence_names[:2]
    for name in (earlier, later, "blank"):
        subject.run_case(name)
    for name, attempt in subject.case_runs.items():
        expect_same(
            f"an output for the photo '{name}' that later calls do not change",
            attempt.result,
            attempt.shared_result,
            "Does it return the same buffer in every call?",
        )
    expect_same(
        "the same output for the same photo after calls on others",
        subject.result(FIRST_PHOTO),
        subject.call("output", case, request),
        "Does it keep a running average or a counter? Seed random generators from an option, or "
        "declare the capability 'stochastic'.",
    )
    expect_same(
        f"the output of a new instance for the photo '{later}', after '{earlier}' of the same size",
        subject.result(later),
        _infer_with_new_instance(subject, later),
        "Is a result, a camera or a buffer kept by the size of the photo, or from the call before?",
    )


def _infer_with_new_instance(subject: BackendUnderTest, name: str) -> Any:
    """Return the output of a new instance for a photo."""
    case = subject.case(name)
    backend = subject.construct(case)
    try:
        backend.load(subject.device)
        return subject.infer(backend, subject.request(case))
    finally:
        with suppress(Exception):  # reported by 'may_be_loaded_and_closed_again'
            backend.close()


def check_reads_images_as_rgb(subject: BackendUnderTest) -> None:
    """The output for the photo in RGB is not less accurate than for the same photo in BGR."""
    case, request = subject.valid_request()
    kind, in_rgb = _error(subject, subject.result(), case)
    if not in_rgb >= _NEGLIGIBLE_ERROR:
        return
    exchanged = replace(request, image=np.ascontiguousarray(request.image[..., ::-1]))
    try:
        answer = subject.infer(subject.loaded(case), exchanged)
    except PhysicError as error:
        raise CheckSkipped("it refuses a photo with red and blue exchanged") from error
    if case_violations(subject.interface, answer, case):
        return
    _, other = _error(subject, answer, case)
    expect(
        not other <= MAX_RATIO * in_rgb,
        "the smaller error for the photo in RGB order",
        f"an error ({kind}) of {in_rgb:.3f}, but of {other:.3f} for the photo with red and blue "
        f"exchanged",
        "Does it convert the image to BGR, as OpenCV reads files? Images are RGB.",
    )


def check_rows_follow_the_people(subject: BackendUnderTest) -> None:
    """Row i belongs to person i: the truth fits no other order better, and the output for people in
    reverse order is another one.
    """
    case, request = subject.valid_request("several people")
    answer = subject.result("several people")
    count = len(case.people)
    reverse = np.arange(count)[::-1]
    hint = "Do not sort people by size or score."
    _, error = _error(subject, answer, case)
    for order in (reverse, *(np.roll(range(count), k) for k in range(1, count))):
        _, other = _error(subject, rows_of(answer, order, count), case)
        expect(
            not other < MAX_RATIO * error,
            "row i for person i",
            f"an error of {error:.3g}, but of {other:.3g} with rows in the order {order.tolist()}",
            hint,
        )
    wanted = "reversed rows for reversed people"
    reversed_answer = subject.call(wanted, case, rows_of(request, reverse, count))
    is_sorted = describe_difference(answer, rows_of(answer, reverse, count)) and not (
        describe_difference(answer, reversed_answer)
    )
    expect(not is_sorted, wanted, "the same rows", hint)


def check_rows_do_not_depend_on_other_people(subject: BackendUnderTest) -> None:
    """A person alone gets the row that the person has among others."""
    answer = subject.result("several people")
    case = subject.case("several people")
    count = len(case.people)
    changes = []
    for i in range(count):
        row = np.array([i])
        single_case = replace(rows_of(replace(case, world=None), row, count), world=case.world)
        output = subject.call(
            "output for one of several people", single_case, subject.request(single_case)
        )
        changes.append(describe_difference(rows_of(answer, row, count), output))
    differ = list(filter(None, changes))
    report = expect if len(differ) == count else expect_or_warn
    report(
        not differ,
        "the same row for a person alone as among others",
        f"other rows for {len(differ)} of {count} people: {''.join(differ[:1])}",
        "Is a layer in training mode (call eval()), or are values normalized over people? Dynamic "
        "ranges of quantized networks are for all rows of a batch: show it one person at a time.",
    )


def _error(subject: BackendUnderTest, answer: Any, case: Case) -> tuple[str, float]:
    """Return name and value of the main error; NaN where there is no truth for it."""
    try:
        return main_error(subject.table, answer, case)
    except (BodyModelError, CheckSkipped):
        return "", float("nan")


def _expect_valid_output(subject: BackendUnderTest, name: str, hint: str = "") -> None:
    """Raise CheckFailed unless the backend returned valid output for a photo."""
    if name != "one person":
        subject.result()
    attempt = subject.run_case(name)
    wanted = f"valid output for a photo of {subject.case(name).size}, {CASES[name].what}"
    if isinstance(attempt.error, ConfigError):
        raise CheckSkipped(f"not ready: {attempt.error}")
    if attempt.error is not None:
        got = describe_error(attempt.error, subject.kind)
        raise CheckFailed(wanted, got, hint) from attempt.error
    expect(not attempt.violations, wanted, "; ".join(attempt.violations), hint)


CHECKS: tuple[Check, ...] = (
    Check(check_returns_valid_output, after=("class_fits_its_interface",)),
    Check(check_accepts_photos_of_people),
    Check(check_accepts_or_refuses_any_photo, after=("accepts_photos_of_people",)),
    Check(check_does_not_modify_its_input),
    Check(check_output_depends_on_the_photo_alone, unless=SAME),
    GRAY,
    ARRAY_VIEWS,
)
"""Checks of every interface, in order of execution."""

WITHOUT_PEOPLE = Check(check_accepts_a_photo_without_people)
"""Check of interfaces whose output has one row per person."""

ROWS = (
    Check(check_rows_follow_the_people),
    Check(check_rows_do_not_depend_on_other_people, after=("rows_follow_the_people",), unless=SAME),
)
"""Checks of interfaces that receive people."""

COLOURS = Check(check_reads_images_as_rgb)
"""Check of interfaces whose backends process the whole photo."""
