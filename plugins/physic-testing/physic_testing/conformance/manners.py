"""What calls of a backend leave behind in the process: seeds, threads, switches, files, printed
text and memory.
"""

from __future__ import annotations

import gc
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.network_and_memory import resident_megabytes

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

CALLS = 20
"""Calls with one photo, over which memory is measured."""

MAX_LEAK_MB = 0.3
"""Growth of the memory per call that is treated as zero: allocators keep some of what is freed."""

MAX_LEAK_SECONDS = 0.5
"""CPU time for these calls, s.

Slower backends are called again only if the memory grew in the calls before.
"""

MAX_KEPT_MB = 1.0
"""Arrays and tensors that a closed backend may hold, MB."""

_WARM_CALLS = 4
_LEAK = (
    "Does it keep inputs, outputs or tensors with their gradients in a list, or a cache "
    "without a bound?"
)


def held_arrays(thing: Any) -> dict[int, int]:
    """Return the bytes of the arrays, tensors and networks that an object and its class hold, by
    their id.
    """
    from physic_testing.conformance.attributes import attribute_values

    sizes: dict[int, int] = {}
    of_class = attribute_values(
        {name: value for kind in type(thing).__mro__ for name, value in vars(kind).items()}
    )
    for value in (*attribute_values(thing).values(), *of_class.values()):
        if isinstance(getattr(value, "nbytes", None), int):
            sizes[id(value)] = value.nbytes
        elif is_network(value) and hasattr(value, "state_dict"):
            sizes |= {id(p): p.nbytes for p in value.parameters()}
    return sizes


def is_network(value: Any) -> bool:
    """Return whether an object is a network of torch, or a session of ONNX Runtime."""
    is_torch = callable(getattr(value, "parameters", None)) and hasattr(value, "state_dict")
    return (is_torch or hasattr(value, "get_providers")) and not isinstance(value, type)


def check_changes_no_settings_of_the_process(subject: BackendUnderTest) -> None:
    """`load` and `infer` leave random generators, precision, threads, filters, environment, ... as
    they were.
    """
    subject.result()
    texts = sorted(subject.watch.changed.values())
    expect(
        not texts,
        "the state of the process as before the call: physic_core.discovery.process_settings "
        "lists it",
        f"another value of {', '.join(texts)}",
        "Use generators of your own, np.random.default_rng(seed) or torch.Generator, and options "
        "of the session for "
        "threads; use `with torch.no_grad()`.",
    )


def check_writes_no_files(subject: BackendUnderTest) -> None:
    """Calls write no file into the current folder, which is the user's."""
    subject.result()
    names = sorted(subject.watch.files)
    expect(
        not names,
        "no new file in the current folder",
        ", ".join(names[:3]),
        "Write where an option says.",
    )


def check_prints_nothing(subject: BackendUnderTest) -> None:
    """Calls print nothing: the standard output belongs to the command, and may be JSON."""
    subject.result()
    text = subject.watch.printed.strip()
    expect(
        not text,
        "no text on the standard output",
        repr(text[:60]),
        "Use `logging`, or the notes of the result.",
    )


def check_needs_no_more_memory_in_later_calls(subject: BackendUnderTest) -> None:
    """Twenty calls with one photo need no more memory than a few: nothing piles up."""
    subject.result()
    case = subject.case("one person")
    backend = subject.loaded(case)
    held = held_arrays(backend)
    once = subject.watch.after_one_call
    calls = len(subject.case_runs)
    if once is not None and len(held) - len(once) >= calls - 1:
        leak = (sum(held.values()) - sum(once.values())) / 1e6 / calls
        expect(
            leak <= MAX_LEAK_MB,
            "arrays that do not pile up",
            f"{leak:.1f} MB more with each call",
            _LEAK,
        )
    grew = (
        float(np.median(subject.watch.growth[_WARM_CALLS:]))
        if len(subject.watch.growth) > _WARM_CALLS
        else 0.0
    )
    if grew <= MAX_LEAK_MB and CALLS * float(np.median(subject.watch.seconds)) > MAX_LEAK_SECONDS:
        return
    for _ in range(_WARM_CALLS):
        subject.infer(backend, case)
    before = resident_megabytes()
    for _ in range(CALLS - _WARM_CALLS):
        subject.infer(backend, case)
    gc.collect()
    leak = (resident_megabytes() - before) / (CALLS - _WARM_CALLS)
    expect(
        leak <= MAX_LEAK_MB,
        f"memory that stays the same over {CALLS} calls with one photo",
        f"{leak:.1f} MB more with each call",
        _LEAK,
    )


def check_close_releases_memory(subject: BackendUnderTest) -> None:
    """After `close`, the backend holds no weights."""
    kept = subject.watch.kept_mb
    if kept is None:
        raise CheckSkipped("it was not closed")
    expect(
        kept <= MAX_KEPT_MB,
        f"at most {MAX_KEPT_MB:g} MB of arrays in a closed backend",
        f"{kept:.0f} MB",
        "Set the network to None in close().",
    )


_BACKEND = "physic_core.interfaces.Backend"
CHECKS: tuple[Check, ...] = (
    Check(check_changes_no_settings_of_the_process, _BACKEND),
    Check(check_writes_no_files, _BACKEND, warns=True),
    Check(check_prints_nothing, _BACKEND, warns=True),
    Check(
        check_needs_no_more_memory_in_later_calls,
        _BACKEND,
        warns=True,
        after=("keeps_no_state_between_photos",),
    ),
    Check(check_close_releases_memory, _BACKEND, warns=True, after=("works_again_after_close",)),
)
"""Checks of manners, which warn, but for that of settings, which change the results of others; they
run last.
"""
