"""Checks of a backend's life: constructed cheaply and offline, loaded, closed, loaded again."""

from __future__ import annotations

import gc
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import describe
from physic_core.discovery.readiness import missing_requirements
from physic_core.errors import PhysicError
from physic_testing.conformance.asking import difference
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.guard import no_network, resident_megabytes

if TYPE_CHECKING:
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.subject import Subject

__all__ = ["AFTER", "BEFORE"]

MISSING_DEVICE = "cuda:99"

MOST_SECONDS, MOST_MEGABYTES = 0.25, 32.0
"""Processor time and memory that a constructor may take."""


def check_constructs_with_its_defaults(subject: Subject) -> None:
    """The constructor takes its options and returns."""
    try:
        subject.construct()
    except Exception as error:
        raise CheckFailed("a backend from its options", describe(error, subject.kind)) from error


def check_constructs_offline(subject: Subject) -> None:
    """The constructor uses no network, not even a name server: downloads belong into load, if anywhere."""
    options = subject.options()
    with no_network() as asked, suppress(Exception):  # 'constructs_with_its_defaults' says what else it raises
        subject.kind(options)
    expect(
        not asked,
        "a constructor that uses no network",
        f"it asks for {', '.join(dict.fromkeys(asked))}",
        "Fetch weights in load(), or better in a command of your own.",
    )


def check_constructs_cheaply(subject: Subject) -> None:
    """The constructor loads nothing: a config is checked by constructing every backend."""
    best, memory, kept = float("inf"), float("inf"), []
    for _ in range(3):  # The first one may import modules; what all of them take is the constructor's own.
        gc.collect()
        before, start = resident_megabytes(), time.process_time()
        kept.append(subject.construct())
        best = min(best, time.process_time() - start)
        memory = min(memory, resident_megabytes() - before)
        if best < MOST_SECONDS and memory < MOST_MEGABYTES:
            return
    raise CheckFailed(
        f"a constructor of less than {MOST_SECONDS} s of processor time and {MOST_MEGABYTES:.0f} MB",
        f"{best:.2f} s and {memory:.0f} MB, each time",
        "Read weights in load().",
    )


def check_loads_or_reports_what_is_missing(subject: Subject) -> None:
    """`missing` lists offline what is missing; else `load` works, or raises a PhysicError with the cause."""
    if "needs_cuda" in subject.capabilities and subject.device == "cpu":
        raise CheckSkipped("needs a GPU: give the device 'cuda'")
    backend = _fresh(subject)
    with no_network() as asked:
        try:
            lacking = missing_requirements(backend)
        except PhysicError as error:
            raise CheckFailed(
                "missing() to return a tuple of texts, empty where nothing is missing", str(error)
            ) from error
    expect(not asked, "missing() to use no network", f"it asks for {', '.join(dict.fromkeys(asked))}")
    if lacking:
        _expect_help("; ".join(lacking))
        raise CheckSkipped(f"not ready: {'; '.join(lacking)}")
    try:
        backend.load(subject.device)
    except PhysicError as error:
        _expect_help(str(error))
        raise CheckSkipped(f"not ready: {error}") from error
    except Exception as error:
        raise CheckFailed(
            "load() to work, or a physic_core.errors.BackendError that says which file is missing and where to get it",
            describe(error, subject.kind),
        ) from error
    _quietly_closed(backend)


def _expect_help(said: str) -> None:
    expect(len(said.split()) >= 4, "a message that says what is missing and where to get it", repr(said))


def check_refuses_a_missing_device(subject: Subject) -> None:
    """`load` of a GPU that is not there raises a PhysicError, unless the backend needs no device at all."""
    backend = _fresh(subject)
    try:
        backend.load(MISSING_DEVICE)
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(
            f"load({MISSING_DEVICE!r}) to raise a physic_core.errors.DeviceError, or to do without a device",
            describe(error, subject.kind),
            "physic_core.adapters.devices.check_device(device) says it in words.",
        ) from error
    _quietly_closed(backend)


def check_infer_before_load_works_or_raises(subject: Subject) -> None:
    """`infer` before `load` works, or raises a PhysicError."""
    subject.answer()
    try:
        subject.ask(_fresh(subject), subject.case("one person"))
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(
            "infer() before load() to work, or to raise a physic_core.errors.BackendError",
            describe(error, subject.kind),
        ) from error


def check_load_and_close_may_be_repeated(subject: Subject) -> None:
    """`close` before `load`, `load` twice and `close` twice are allowed."""
    subject.answer()
    backend = _fresh(subject)
    for i, (step, call) in enumerate(
        (
            ("close() before load()", backend.close),
            ("load()", lambda: backend.load(subject.device)),
            ("a second load()", lambda: backend.load(subject.device)),
            ("close()", backend.close),
            ("a second close()", backend.close),
        )
    ):
        try:
            call()
        except Exception as error:
            before = "" if i else ", on a fresh backend"
            raise CheckFailed(f"{step} to do no harm{before}", describe(error, subject.kind)) from error


def check_works_again_after_close(subject: Subject) -> None:
    """After `close` and another `load` the output is the same as before."""
    first = subject.answer("odd size")
    case = subject.case("odd size")
    backend = _fresh(subject, case)
    try:
        backend.load(subject.device)
        backend.close()
        backend.load(subject.device)
        again = subject.ask(backend, case)
    except Exception as error:
        raise CheckFailed("an answer after load(), close(), load()", describe(error, subject.kind)) from error
    finally:
        _quietly_closed(backend)
    if "stochastic" not in subject.capabilities:
        told = difference(first, again)
        expect(not told, "the same answer after load(), close(), load()", told)


def _fresh(subject: Subject, case: Case | None = None) -> Any:
    try:
        return subject.construct(case)
    except Exception as error:
        raise CheckSkipped("it cannot be constructed: see 'constructs_with_its_defaults'") from error


def _quietly_closed(backend: Any) -> None:
    with suppress(Exception):  # 'load_and_close_may_be_repeated' says it
        backend.close()


_BACKEND = "physic_core.interfaces.Backend"
_WHOLE = ("target_is_a_concrete_class", "options_have_defaults")
_CONSTRUCTED = ("constructs_with_its_defaults",)
BEFORE: tuple[Check, ...] = (
    Check(check_constructs_offline, _BACKEND, after=_WHOLE),
    Check(check_constructs_with_its_defaults, _BACKEND, after=(*_WHOLE, "constructs_offline")),
    Check(check_constructs_cheaply, _BACKEND, after=_CONSTRUCTED),
    Check(check_loads_or_reports_what_is_missing, _BACKEND, after=_CONSTRUCTED),
    Check(check_refuses_a_missing_device, "physic_core.adapters.devices", after=("loads_or_reports_what_is_missing",)),
)
"""Before a backend is asked anything."""

AFTER: tuple[Check, ...] = (
    Check(check_infer_before_load_works_or_raises, _BACKEND),
    Check(check_load_and_close_may_be_repeated, _BACKEND),
    Check(
        check_works_again_after_close,
        _BACKEND,
        after=("load_and_close_may_be_repeated", "is_deterministic", "keeps_no_state_between_photos"),
    ),
)
"""Once it has answered."""
