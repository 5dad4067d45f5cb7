"""Checks of the output of every backend: valid for all kinds of photos, and of the photo alone."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import BodyModelError, ConfigError, PhysicError
from physic_core.interfaces.comparison import describe_difference, named_values
from physic_core.types import Hints
from physic_testing.conformance.accuracy import MAIN_ERROR, main_error
from physic_testing.conformance.backend_under_test import FIRST_PHOTO
from physic_testing.conformance.cases import CASES, rows_of
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.contract import case_violations
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect, warn_unless
from physic_testing.conformance.requests import read_only_view

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

REQUIRED = {
    "several people": "Are masks inverted, or those of whole people?",
    "walking": "Does it mix up width and height?",
    "odd size": "Does it pad or crop to a multiple of 14 or 32, and not resize the output back?",
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
_SAME = frozenset({"stochastic"})


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
    edited = {
        place for attempt in subject.case_runs.values() for place in attempt.changed_arguments
    }
    expect(
        not edited,
        "photo, people, keypoints and hints as they were before infer()",
        f"other values in {', '.join(sorted(edited))}",
        "Copy before you write: `image.copy()`, `a = a + 1` in place of `a += 1`.",
    )


def check_accepts_array_views(subject: BackendUnderTest) -> None:
    """infer accepts read-only arrays with negative strides, which photos rotated by EXIF data
    have.
    """
    case, request = subject.valid_request("odd size")
    wanted = "valid output for read-only arrays with negative strides"
    hint = "Call np.ascontiguousarray(array) before torch.from_numpy; copy before writing."
    answer = subject.call(wanted, case, read_only_view(request), hint)
    if "stochastic" not in subject.capabilities:
        wanted = "the same output for a view of the same photo"
        _expect_same(wanted, subject.result("odd size"), answer)


def check_output_depends_on_the_photo_alone(subject: BackendUnderTest) -> None:
    """The output is the same in a second call after others, and of a second instance with the same
    options.
    """
    case, request = subject.valid_request(FIRST_PHOTO)
    earlier, later = subject.photos_of_one_size
    for name in (earlier, later, "blank"):
        subject.run_case(name)
    for name, attempt in subject.case_runs.items():
        _expect_same(
            f"an output for the photo '{name}' that later calls do not change",
            attempt.result,
            attempt.shared_result,
            "Does it return the same buffer in every call?",
        )
    _expect_same(
        "the same output for the same photo after calls on others",
        subject.result(FIRST_PHOTO),
        subject.call("output", case, request),
        "Does it keep a running average or a counter? Seed random generators from an option, or "
        "declare the capability 'stochastic'.",
    )
    _expect_same(
        f"the output of a new instance for the photo '{later}', after '{earlier}' of the same size",
        subject.result(later),
        _of_new_instance(subject, later),
        "Is a result, a camera or a buffer kept by the size of the photo, or from the call before?",
    )


def _expect_same(wanted: str, first: Any, again: Any, hint: str = "") -> None:
    changes = describe_difference(first, again)
    expect(not changes, wanted, changes, hint)


def _of_new_instance(subject: BackendUnderTest, name: str) -> Any:
    """Return the output of a new instance for a photo."""
    case = subject.case(name)
    backend = subject.construct(case)
    try:
        backend.load(subject.device)
        return subject.infer(backend, subject.request(case))
    finally:
        with suppress(Exception):  # reported by 'may_be_loaded_and_closed_again'
            backend.close()


def check_works_without_hints(subject: BackendUnderTest) -> None:
    """Without hints, the output is valid or infer raises a PhysicError."""
    case, request = subject.valid_request()
    wanted = "valid output for Hints(), or a PhysicError that names the missing hint"
    subject.call(wanted, case, replace(request, hints=Hints()), may_refuse=True)


def check_ignores_the_image(subject: BackendUnderTest) -> None:
    """The output for a grey photo is the same, as the capability "ignores_image" declares."""
    case = subject.case("one person")
    request = subject.request(case)
    grey = replace(request, image=np.full_like(request.image, 128))
    _expect_same(
        "the same output for an image all gray, as the capability 'ignores_image' declares",
        subject.result(),
        subject.infer(subject.loaded(case), grey),
        "Remove 'ignores_image' from `capabilities`: the checks of bias then run.",
    )


def check_reads_images_as_rgb(subject: BackendUnderTest) -> None:
    """The output for the photo in RGB is not less accurate than for the same photo in BGR."""
    case, request = subject.valid_request()
    own = _error(subject.interface, subject.result(), case)
    if not own >= _NEGLIGIBLE_ERROR:
        return
    exchanged = replace(request, image=np.ascontiguousarray(request.image[..., ::-1]))
    try:
        answer = subject.infer(subject.loaded(case), exchanged)
    except PhysicError as error:
        raise CheckSkipped("it refuses a photo with red and blue exchanged") from error
    if case_violations(subject.interface, answer, case):
        return
    other = _error(subject.interface, answer, case)
    expect(
        not other <= MAX_RATIO * own,
        "the smaller error for the photo in RGB order",
        f"an error ({MAIN_ERROR[subject.interface]}) of {own:.3f}, but of {other:.3f} for the "
        "photo with red and blue exchanged",
        "Does it convert the image to BGR, as OpenCV reads files? Images are RGB.",
    )


def check_rows_follow_the_people(subject: BackendUnderTest) -> None:
    """Row i belongs to person i: the truth fits no other order better, and a person alone gets the
    row that the person has among others.
    """
    case, request = subject.valid_request("several people")
    answer = subject.result("several people")
    count = len(case.people)
    own = _error(subject.interface, answer, case)
    hint = "Do not sort people by size or score."
    for order in (np.arange(count)[::-1], *(np.roll(range(count), k) for k in range(1, count))):
        other = _error(subject.interface, rows_of(answer, order, count), case)
        expect(
            not other < MAX_RATIO * own,
            "row i for person i",
            f"an error of {own:.3g}, but of {other:.3g} with rows in the order {order.tolist()}",
            hint,
        )
    turned = np.arange(count)[::-1]
    reverse = rows_of(request, turned, count)
    again = subject.call("output for the same people in reverse order", case, reverse)
    apart = _row_differences(answer, again, count)
    expect(
        not apart.any() or np.trace(apart[::-1]) < MAX_RATIO * np.trace(apart),
        "reversed rows for reversed people",
        "rows in another order",
        hint,
    )


def check_rows_do_not_depend_on_other_people(subject: BackendUnderTest) -> None:
    """A person alone gets the row that the person has among others."""
    answer = subject.result("several people")
    case = subject.case("several people")
    count = len(case.people)
    changes = {}
    for i in range(count):
        row = np.array([i])
        alone = replace(rows_of(replace(case, world=None), row, count), world=case.world)
        own = subject.call("output for one of several people", alone, subject.request(alone))
        if change := describe_difference(rows_of(answer, row, count), own):
            changes[i] = change
    report = expect if len(changes) == count else warn_unless
    report(
        not changes,
        "the same row for a person alone as among others",
        f"other rows for {len(changes)} of {count} people: {next(iter(changes.values()), '')}",
        "Is a layer in training mode (call eval()), or are values normalized over people? Dynamic "
        "ranges of quantised networks are for all rows of a batch: show it one person at a time.",
    )


def _error(interface: str, answer: Any, case: Case) -> float:
    """Return the error of an output, lower is better; NaN where there is no truth for it."""
    try:
        return main_error(interface, answer, case)
    except (BodyModelError, CheckSkipped):
        return float("nan")


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
    Check(check_output_depends_on_the_photo_alone, unless=_SAME),
    Check(check_ignores_the_image, only_with=BLIND, read="physic_testing.conformance.CAPABILITIES"),
    Check(
        check_accepts_array_views,
        after=("output_depends_on_the_photo_alone", "does_not_modify_its_input"),
    ),
)
"""Checks of every interface, in order of execution."""

WITHOUT_HINTS = Check(check_works_without_hints, read="physic_core.types.Hints")
"""Check of interfaces whose ``infer`` receives hints."""

WITHOUT_PEOPLE = Check(check_accepts_a_photo_without_people)
"""Check of interfaces whose output has one row per person."""

ROWS = (
    Check(check_rows_follow_the_people),
    Check(
        check_rows_do_not_depend_on_other_people, after=("rows_follow_the_people",), unless=_SAME
    ),
)
"""Checks of interfaces that receive people."""

COLOURS = Check(check_reads_images_as_rgb)
"""Check of interfaces whose backends process the whole photo."""


def _row_differences(first: Any, second: Any, count: int) -> FloatArray:
    """Return the mean difference (N, N) of each of ``count`` rows of a result from each row of
    another, every array scaled to at most 1.
    """
    one, other = (_rows(result, count) for result in (first, second))
    apart: FloatArray = np.abs(one[:, None] - other[None]).mean(axis=2)
    return apart


def _rows(result: Any, count: int) -> FloatArray:
    found = []
    for _, value in named_values(result):
        if isinstance(value, np.ndarray) and value.ndim and len(value) == count:
            flat = np.nan_to_num(value.astype(np.float64).reshape(count, -1))
            found.append(flat / max(float(np.abs(flat).max(initial=0)), 1e-9))
    return np.concatenate(found, axis=1)
