"""What calls of a backend leave behind in the process: settings, files, printed text and memory."""

from __future__ import annotations

import gc
import time
from typing import TYPE_CHECKING

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect, warn_unless
from physic_testing.conformance.network_and_memory import resident_megabytes

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

CALLS = 16
"""Calls with one photo, over which memory is measured after four others."""

MAX_LEAK_MB = 0.3
"""Growth of the memory per call that is treated as zero: allocators keep some of what is freed."""

MAX_LEAK_SECONDS = 2.0
"""CPU time for these calls, s; slower backends are not called again."""


def check_changes_no_settings_of_the_process(subject: BackendUnderTest) -> None:
    """`load` and `infer` leave random generators, precision, threads, filters, environment, ... as
    they were.
    """
    subject.result()
    texts = sorted(subject.watch.changed)
    expect(
        not texts,
        "the state of the process as before the call",
        f"another value of {', '.join(texts)}",
        "Use generators of your own, np.random.default_rng(seed) or torch.Generator, and options "
        "of the session for threads; use `with torch.no_grad()`.",
    )


def check_leaves_nothing_behind(subject: BackendUnderTest) -> None:
    """Calls write no file into the current folder and print nothing; later calls need no more
    memory.
    """
    subject.result()
    names = sorted(subject.watch.files)
    text = subject.watch.printed.strip()
    warn_unless(not names, "no new file in the current folder", ", ".join(names[:3]))
    warn_unless(
        not text, "no text on the standard output, which may be JSON", repr(text[:60]), "Use notes."
    )
    case = subject.case("one person")
    backend = subject.loaded(case)
    start = time.process_time()
    for _ in range(4):
        subject.infer(backend, subject.request(case))
        if (time.process_time() - start) * CALLS > 4 * MAX_LEAK_SECONDS:
            raise CheckSkipped("memory was not measured: it is too slow to be called 20 times")
    memory = resident_megabytes()
    for _ in range(CALLS):
        subject.infer(backend, subject.request(case))
    gc.collect()
    leak = (resident_megabytes() - memory) / CALLS
    warn_unless(
        leak <= MAX_LEAK_MB,
        f"memory that stays the same over {CALLS} calls with one photo",
        f"{leak:.1f} MB more with each call",
        "Does it keep inputs, outputs or tensors with their gradients in a list, or a cache?",
    )


CHECKS: tuple[Check, ...] = (
    Check(check_changes_no_settings_of_the_process),
    Check(check_leaves_nothing_behind, after=("output_depends_on_the_photo_alone",)),
)
"""Checks that run last; what is left behind is a warning."""
