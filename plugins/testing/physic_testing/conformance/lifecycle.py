"""Checks of a backend's life cycle: constructor, missing files, load, close and reload."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from physic_core.discovery.backends import missing_requirements
from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_testing.conformance.cases import FIRST_PHOTO
from physic_testing.conformance.check import SAME, Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect, expect_same
from physic_testing.conformance.network_and_memory import no_network, resident_megabytes

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MISSING_DEVICE = "cuda:99"
"""Name of a device that does not exist on any test machine."""

MAX_SECONDS = 0.25
"""Maximum CPU time of a constructor, of ``missing`` and of ``fingerprint``, s: every run calls
them.
"""

MAX_MEGABYTES = 32.0
"""Maximum memory of a constructor, MB."""


def check_constructs_quickly_and_offline(subject: BackendUnderTest) -> None:
    """The constructor accepts the default options, uses no network, and loads no weights."""
    options = subject.options_for()
    gc.collect()
    memory = resident_megabytes()
    kept = _timed_calls(subject, "the constructor", lambda: subject.kind(options))
    memory = (resident_megabytes() - memory) / len(kept)
    expect(
        memory < MAX_MEGABYTES,
        f"a constructor that takes less than {MAX_MEGABYTES:.0f} MB",
        f"{memory:.0f} MB",
        "Read weights in load().",
    )


def check_tells_what_is_missing_before_load(subject: BackendUnderTest) -> None:
    """Before `load`, `missing` and `fingerprint` are fast, offline, and the same in each call."""
    backend = subject.construct_or_skip()
    calls: dict[str, Callable[[], Any]] = {
        "missing()": lambda: missing_requirements(backend),
        "fingerprint()": lambda: subject.construct_or_skip().fingerprint(),
    }
    for name, call in calls.items():
        answers = _timed_calls(subject, name, call)
        expect(
            all(answer == answers[0] for answer in answers),
            f"{name} to return the same in each call",
            f"{answers!r}",
            "If the fingerprint changes between calls, cached results are never used.",
        )
    expect(isinstance(answers[0], str), "fingerprint() to return a str", repr(answers[0]))


def check_loads_or_reports_what_is_missing(subject: BackendUnderTest) -> None:
    """`missing` lists missing files; if it lists none, `load` works or raises a PhysicError."""
    if "needs_cuda" in subject.declared and subject.device == "cpu":
        raise CheckSkipped("needs a GPU: pass device='cuda'")
    backend = subject.construct_or_skip()
    lacking = "; ".join(missing_requirements(backend))
    if not lacking:
        lacking = _try_step(subject, "load()", lambda: backend.load(subject.device))
        with suppress(Exception):  # reported by 'may_be_loaded_and_closed_again'
            backend.close()
    if lacking:
        is_helpful = len(lacking.split()) >= 4
        expect(is_helpful, "a message with what is missing and where to get it", repr(lacking))
        raise CheckSkipped(f"not ready: {lacking}")


def check_may_be_loaded_and_closed_again(subject: BackendUnderTest) -> None:
    """`infer` before `load`, and `load` of a GPU that does not exist, work or raise a PhysicError;
    `load` and `close` may be repeated, and the output stays the same.
    """
    case = subject.valid_request(FIRST_PHOTO)[0]
    backend = subject.construct_or_skip(case)
    outputs: list[Any] = []
    load = partial(backend.load, subject.device)

    def infer() -> None:
        outputs.append(subject.infer(backend, subject.request(case)))

    steps: dict[str, Callable[[], Any]] = {
        "infer() before load()": infer,
        f"load({MISSING_DEVICE!r})": partial(backend.load, MISSING_DEVICE),
        "close() after no load()": backend.close,
        "load()": load,
        "a second load()": load,
        "close()": backend.close,
        "a second close()": backend.close,
        "load() after close()": load,
        "infer() after load(), close(), load()": infer,
    }
    for step, call in steps.items():
        refusal = _try_step(subject, step, call)
        expect(not refusal or step in [*steps][:2], f"{step} to work", refusal)
    with suppress(Exception):
        backend.close()
    if not SAME & subject.declared:
        wanted = "the same output after load(), close(), load()"
        expect_same(wanted, subject.result(FIRST_PHOTO), outputs[-1])


def _try_step(subject: BackendUnderTest, step: str, call: Callable[[], Any]) -> str:
    """Call something, and return the message of a PhysicError, or an empty text.

    Raises:
        CheckFailed: it raised another error.
    """
    try:
        call()
    except PhysicError as error:
        return str(error)
    except Exception as error:
        raise CheckFailed(
            f"{step} to work, or to raise a physic_core.errors.BackendError or DeviceError with "
            f"what is missing and where to get it",
            describe_error(error, subject.kind),
            "physic_core.backends.devices.check_device(device) raises the error of a device.",
        ) from error
    return ""


def _timed_calls(subject: BackendUnderTest, name: str, call: Callable[[], Any]) -> list[Any]:
    """Return the results of two or three calls, of which the fastest is fast, without network."""
    answers: list[Any] = []
    best = float("inf")
    with no_network() as addresses, suppress(OSError):
        while len(answers) < 2 or (len(answers) < 3 and best > MAX_SECONDS):  # the first may import
            start = time.process_time()
            answers.append(call())
            best = min(best, time.process_time() - start)
    expect(
        not addresses,
        f"{name} to use no network",
        f"it requests {', '.join(dict.fromkeys(addresses))}",
        "Download weights by a command of their own.",
    )
    expect(
        best < MAX_SECONDS,
        f"{name} in less than {MAX_SECONDS} s of processor time",
        f"{best:.2f} s, each time",
        "Read weights in load(); physic_core.weights.fingerprint reads a file only if it changes.",
    )
    return answers


CHECKS_BEFORE_INFER: tuple[Check, ...] = (
    Check(
        check_constructs_quickly_and_offline,
        after=("class_fits_its_interface", "options_are_complete"),
    ),
    Check(check_tells_what_is_missing_before_load, after=("constructs_quickly_and_offline",)),
    Check(check_loads_or_reports_what_is_missing, after=("tells_what_is_missing_before_load",)),
)
"""Life-cycle checks that run before the first call of ``infer``."""

CHECKS_AFTER_INFER: tuple[Check, ...] = (
    Check(check_may_be_loaded_and_closed_again, after=("output_depends_on_the_photo_alone",)),
)
"""Life-cycle checks that run after ``infer`` returned valid output."""
