"""Checks of every backend's answers: their form on photos of all kinds, and that asking changes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.discovery.error_text import describe
from physic_core.errors import ConfigError, PhysicError
from physic_testing.conformance.asking import as_views, difference, inputs
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.subject import FIRST

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Attempt, Subject

_BUFFER = "Does it hand out one buffer again and again?"

__all__ = ["CHECKS", "CHECKS_OF_HINTS", "CHECKS_OF_PEOPLE", "check_needs_no_hints"]


def check_returns_valid_output(subject: Subject) -> None:
    """For an ordinary photo the output has the right types, shapes, dtypes and ranges."""
    _expect_answer(subject, "one person")


def check_accepts_several_people(subject: Subject) -> None:
    """For a photo of several people the output is valid."""
    _expect_answer(subject, "several people")


def check_accepts_an_odd_size(subject: Subject) -> None:
    """For a photo of 131 x 97 px, multiples of no patch size, the output is valid."""
    _expect_answer(subject, "odd size", "Does it pad or crop to a multiple of 14, 16 or 32, and forget to go back?")


def check_accepts_a_portrait(subject: Subject) -> None:
    """For a photo that is higher than wide the output is valid."""
    _expect_answer(subject, "portrait", "Does it mix up width and height?")


def check_accepts_a_photo_without_people(subject: Subject) -> None:
    """For a photo without people the output has N = 0 rows; it is neither an error nor None."""
    _expect_answer(subject, "nobody", "Nobody is an answer too: arrays of 0 rows.")


def check_accepts_or_refuses_a_blank_photo(subject: Subject) -> None:
    """For a photo of one grey the output is valid, or infer raises a PhysicError."""
    _expect_answer_or_refusal(subject, "blank", "Does it divide by a range or a deviation that is 0?")


def check_accepts_or_refuses_a_tiny_photo(subject: Subject) -> None:
    """For a photo of 32 x 24 px the output is valid, or infer raises a PhysicError."""
    _expect_answer_or_refusal(subject, "tiny", "Does it round a size down to 0?")


def check_accepts_or_refuses_a_large_photo(subject: Subject) -> None:
    """For a large photo the output is valid, or infer raises a PhysicError."""
    _expect_answer_or_refusal(subject, "large", "Does it assume the size that its network sees?")


def check_does_not_modify_its_input(subject: Subject) -> None:
    """infer does not change its arguments."""
    subject.answer()
    edited = {name: attempt.edited for name, attempt in subject.attempts.items() if attempt.edited}
    places = sorted({place for found in edited.values() for place in found})
    expect(
        not edited,
        "photo, people, keypoints and hints as they were before infer()",
        f"other values in {', '.join(places)} (photo '{next(iter(edited), '')}')",
        "Copy before you write: `image.copy()`, `a = a + 1` in place of `a += 1`.",
    )


def check_accepts_array_views(subject: Subject) -> None:
    """Input arrays may be read-only and have negative strides: photos turned by their EXIF tag have."""
    first, case = subject.answer("odd size"), subject.case("odd size")
    try:
        answer = subject.ask(subject.loaded(case), case, as_views(inputs(subject.interface, case)))
    except Exception as error:
        raise CheckFailed(
            "an answer to arrays that are read-only and have strides of their own",
            describe(error, subject.kind),
            "np.ascontiguousarray(image) before torch.from_numpy; a copy before writing.",
        ) from error
    if "stochastic" not in subject.capabilities:
        told = difference(first, answer)
        expect(not told, "the same answer to a view of the same photo", told)


def check_is_deterministic(subject: Subject) -> None:
    """A second instance with the same options returns the same output for the first photo."""
    first, case = subject.answer(FIRST), subject.case(FIRST)
    backend = subject.construct(case)
    try:
        backend.load(subject.device)
        told = difference(first, subject.ask(backend, case))
    finally:
        _close(backend)
    expect(
        not told,
        "the same answer from a second backend with the same options",
        told,
        "Seed every generator from an option; claim the capability 'stochastic' where that cannot be.",
    )


def check_keeps_no_state_between_photos(subject: Subject) -> None:
    """An output does not depend on earlier photos, and no later call changes it."""
    first, case = subject.answer(FIRST), subject.case(FIRST)
    for name in ("one person", "blank"):
        subject.attempt(name)
    for name, attempt in subject.attempts.items():
        told = difference(attempt.answer, attempt.returned)
        expect(not told, f"the answer to the photo '{name}' to stay", f"a later call changed it: {told}", _BUFFER)
    try:
        again = subject.ask(subject.loaded(case), case)
    except Exception as error:
        raise CheckFailed("an answer to the same photo again", describe(error, subject.kind)) from error
    told = difference(first, again)
    expect(
        not told,
        "the same answer to the same photo after others",
        told,
        "Does it average over calls, or count them?",
    )


def check_needs_no_hints(subject: Subject) -> None:
    """Without hints the output is valid, or infer raises a PhysicError."""
    from physic_core.types import Hints
    from physic_testing.conformance.asking import form_faults

    subject.answer()
    case = subject.case("one person")
    arguments = tuple(Hints() if isinstance(a, Hints) else a for a in inputs(subject.interface, case))
    try:
        answer = subject.ask(subject.loaded(case), case, arguments)
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(
            "an answer to Hints(), in which everything is None, or a PhysicError that names what is missing",
            describe(error, subject.kind),
        ) from error
    faults = form_faults(subject.interface, answer, case)
    expect(not faults, "an answer of the right form to Hints()", "; ".join(faults))


def _expect_answer(subject: Subject, name: str, hint: str = "") -> None:
    attempt = _attempt(subject, name)
    case = subject.case(name)
    wanted = f"an answer of the right form to a photo of {case.size}, {_what(name)}"
    if isinstance(attempt.error, ConfigError):
        raise CheckSkipped(f"not ready: {attempt.error}")
    if attempt.error is not None:
        raise CheckFailed(wanted, describe(attempt.error, subject.kind), hint) from attempt.error
    expect(not attempt.faults, wanted, "; ".join(attempt.faults), hint)


def _expect_answer_or_refusal(subject: Subject, name: str, hint: str) -> None:
    attempt = _attempt(subject, name)
    if not attempt.refused:
        _expect_answer(subject, name, f"{hint} A photo that cannot be used is refused with a PhysicError.")


def _attempt(subject: Subject, name: str) -> Attempt:
    if name != "one person":
        subject.answer("one person")
    return subject.attempt(name)


def _what(name: str) -> str:
    from physic_testing.conformance.cases import CASES

    return CASES[name]


def _close(backend: object) -> None:
    try:
        backend.close()  # type: ignore[attr-defined]
    except Exception:
        return  # 'load_and_close_may_be_repeated' says it


_TYPES, _BACKEND = "physic_core.types", "physic_core.interfaces"
_ALONE = frozenset({"stochastic"})
CHECKS: tuple[Check, ...] = (
    Check(check_returns_valid_output, _TYPES, after=("infer_has_the_right_signature",)),
    Check(check_accepts_several_people, _TYPES),
    Check(check_accepts_an_odd_size, _TYPES),
    Check(check_accepts_a_portrait, _TYPES),
    Check(check_accepts_or_refuses_a_blank_photo, _BACKEND),
    Check(check_accepts_or_refuses_a_tiny_photo, _BACKEND),
    Check(check_accepts_or_refuses_a_large_photo, _BACKEND),
    Check(check_does_not_modify_its_input, _BACKEND),
    Check(check_is_deterministic, _BACKEND, unless=_ALONE),
    Check(check_keeps_no_state_between_photos, _BACKEND, unless=_ALONE, after=("is_deterministic",)),
    Check(check_accepts_array_views, _BACKEND, after=("keeps_no_state_between_photos", "does_not_modify_its_input")),
)
"""Of every interface."""

CHECKS_OF_HINTS: tuple[Check, ...] = (Check(check_needs_no_hints, "physic_core.types.Hints"),)
"""Of interfaces whose backends are given hints."""

CHECKS_OF_PEOPLE: tuple[Check, ...] = (Check(check_accepts_a_photo_without_people, _TYPES),)
"""Of interfaces whose answers have a row a person."""
