"""Checks of a backend's life cycle: constructor, load, close and reload."""

from __future__ import annotations

import gc
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from physic_core.discovery.backends import missing_requirements
from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_testing.conformance.attributes import attribute_values, replaced_attributes
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.field_comparison import describe_difference
from physic_testing.conformance.manners import held_arrays, is_network
from physic_testing.conformance.network_and_memory import no_network, resident_megabytes

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MISSING_DEVICE = "cuda:99"
"""Name of a device that does not exist on any test machine."""

MAX_SECONDS = 0.25
MAX_MEGABYTES = 32.0
"""Maximum CPU time, s, and maximum memory, MB, of a constructor."""


def check_constructs_with_its_defaults(subject: BackendUnderTest) -> None:
    """The constructor accepts the default options."""
    try:
        subject.construct()
    except Exception as error:
        raise CheckFailed(
            "a constructor that accepts the default options", describe_error(error, subject.kind)
        ) from error


def check_constructs_offline(subject: BackendUnderTest) -> None:
    """The constructor makes no network request, not even a DNS lookup: downloads belong in
    `load`.
    """
    options = subject.options()
    # other errors are reported by 'constructs_with_its_defaults'
    with no_network() as requested, suppress(Exception):
        subject.kind(options)
    expect(
        not requested,
        "a constructor that uses no network",
        f"it requests {', '.join(dict.fromkeys(requested))}",
        "Download weights in load(), or better in a separate command.",
    )


def check_constructs_cheaply(subject: BackendUnderTest) -> None:
    """The constructor is fast and loads no weights: a config check constructs every backend."""
    best = float("inf")
    memory = float("inf")
    kept = []
    # The first call may import modules; the minimum is the constructor's own cost.
    for _ in range(3):
        gc.collect()
        before = resident_megabytes()
        start = time.process_time()
        kept.append(subject.construct())
        best = min(best, time.process_time() - start)
        memory = min(memory, resident_megabytes() - before)
        if best < MAX_SECONDS and memory < MAX_MEGABYTES:
            return
    raise CheckFailed(
        f"a constructor of less than {MAX_SECONDS} s of processor time and {MAX_MEGABYTES:.0f} MB",
        f"{best:.2f} s and {memory:.0f} MB, each time",
        "Read weights in load().",
    )


def check_loads_or_reports_what_is_missing(subject: BackendUnderTest) -> None:
    """`missing` lists missing files offline; if it lists none, `load` works or raises a
    PhysicError.
    """
    if "needs_cuda" in subject.capabilities and subject.device == "cpu":
        raise CheckSkipped("needs a GPU: pass device='cuda'")
    backend = subject.new_instance()
    with no_network() as requested:
        try:
            lacking = missing_requirements(backend)
        except PhysicError as error:
            raise CheckFailed(
                "missing() to return a tuple of texts, empty where nothing is missing", str(error)
            ) from error
    expect(
        not requested,
        "missing() to use no network",
        f"it requests {', '.join(dict.fromkeys(requested))}",
    )
    if lacking:
        _expect_helpful_message("; ".join(lacking))
        raise CheckSkipped(f"not ready: {'; '.join(lacking)}")
    try:
        backend.load(subject.device)
    except PhysicError as error:
        _expect_helpful_message(str(error))
        raise CheckSkipped(f"not ready: {error}") from error
    except Exception as error:
        raise CheckFailed(
            "load() to work, or to raise a physic_core.errors.BackendError with the missing file "
            "and its source",
            describe_error(error, subject.kind),
        ) from error
    _close_quietly(backend)


def _expect_helpful_message(message: str) -> None:
    """Raise CheckFailed if a message is shorter than four words."""
    expect(
        len(message.split()) >= 4,
        "a message with what is missing and where to get it",
        repr(message),
    )


def check_refuses_a_missing_device(subject: BackendUnderTest) -> None:
    """`load` raises a PhysicError for a GPU that does not exist; a backend without a network may
    ignore it.
    """
    backend = subject.new_instance()
    try:
        backend.load(MISSING_DEVICE)
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(
            f"load({MISSING_DEVICE!r}) to raise a physic_core.errors.DeviceError, or to work "
            f"without a device",
            describe_error(error, subject.kind),
            "physic_core.adapters.devices.check_device(device) raises this error.",
        ) from error
    networks = [path for path, value in attribute_values(backend).items() if is_network(value)]
    _close_quietly(backend)
    expect(
        not networks,
        f"load({MISSING_DEVICE!r}) to raise a physic_core.errors.DeviceError, or to work without "
        f"a device",
        f"a network in {networks[0] if networks else ''}",
        "Does it fall back to the CPU in silence?",
    )


def check_infer_before_load_works_or_raises(subject: BackendUnderTest) -> None:
    """`infer` before `load` works or raises a PhysicError."""
    subject.result()
    try:
        subject.infer(subject.new_instance(), subject.case("one person"))
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(
            "infer() before load() to work, or to raise a physic_core.errors.BackendError",
            describe_error(error, subject.kind),
        ) from error


def check_load_and_close_may_be_repeated(subject: BackendUnderTest) -> None:
    """`close` before `load`, a second `load` and a second `close` raise no error."""
    subject.result()
    backend = subject.new_instance()
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
            raise CheckFailed(
                f"{step} to raise no error{before}", describe_error(error, subject.kind)
            ) from error


def check_second_load_does_nothing(subject: BackendUnderTest) -> None:
    """A second `load` of a loaded backend replaces nothing: a pipeline loads once and is called
    many times.
    """
    subject.result()
    backend = subject.new_instance()
    try:
        backend.load(subject.device)
        before = attribute_values(backend)
        backend.load(subject.device)
        replaced = replaced_attributes(before, attribute_values(backend))
    finally:
        _close_quietly(backend)
    expect(
        not replaced,
        "a second load() of a loaded backend to do nothing",
        f"it replaces {', '.join(replaced[:3])}",
        "Begin load() with: if self.network is not None: return",
    )


def check_works_again_after_close(subject: BackendUnderTest) -> None:
    """After `close` and a second `load`, the output is the same as before."""
    first = subject.result("odd size")
    case = subject.case("odd size")
    backend = subject.new_instance(case)
    try:
        backend.load(subject.device)
        backend.close()
        subject.watch.kept_mb = sum(held_arrays(backend).values()) / 1e6
        backend.load(subject.device)
        again = subject.infer(backend, case)
        subject.watch.after_one_call = held_arrays(backend)
    except Exception as error:
        raise CheckFailed(
            "output after load(), close(), load()", describe_error(error, subject.kind)
        ) from error
    finally:
        _close_quietly(backend)
    if "stochastic" not in subject.capabilities:
        changes = describe_difference(first, again)
        expect(not changes, "the same output after load(), close(), load()", changes)


def _close_quietly(backend: Any) -> None:
    """Close a backend and ignore errors."""
    with suppress(Exception):  # reported by 'load_and_close_may_be_repeated'
        backend.close()


_BACKEND = "physic_core.interfaces.Backend"
_WHOLE = ("class_fits_its_interface", "options_have_defaults")
_CONSTRUCTED = ("constructs_with_its_defaults",)
CHECKS_BEFORE_INFER: tuple[Check, ...] = (
    Check(check_constructs_offline, _BACKEND, after=_WHOLE),
    Check(check_constructs_with_its_defaults, _BACKEND, after=(*_WHOLE, "constructs_offline")),
    Check(check_constructs_cheaply, _BACKEND, after=_CONSTRUCTED),
    Check(check_loads_or_reports_what_is_missing, _BACKEND, after=_CONSTRUCTED),
    Check(
        check_refuses_a_missing_device,
        "physic_core.adapters.devices",
        after=("loads_or_reports_what_is_missing",),
    ),
)
"""Life-cycle checks that run before the first call of ``infer``."""

CHECKS_AFTER_INFER: tuple[Check, ...] = (
    Check(check_infer_before_load_works_or_raises, _BACKEND),
    Check(check_load_and_close_may_be_repeated, _BACKEND),
    Check(check_second_load_does_nothing, _BACKEND, after=("load_and_close_may_be_repeated",)),
    Check(
        check_works_again_after_close,
        _BACKEND,
        after=(
            "load_and_close_may_be_repeated",
            "is_deterministic",
            "keeps_no_state_between_photos",
        ),
    ),
)
"""Life-cycle checks that run after ``infer`` returned valid output."""
