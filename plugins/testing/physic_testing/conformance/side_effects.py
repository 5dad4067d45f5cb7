"""What calls of a backend leave behind in the process: settings, files, printed text and memory."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from physic_core.weights import search_folders
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect, expect_or_warn
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


_IN_A_NEW_HOME = """
import json, sys
from physic_core.errors import PhysicError
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.expect import CheckSkipped
try:
    backend, interface, *size, settings = sys.argv[1:]
    size = tuple(map(int, size))
    find_backend(backend, interface, size=size, **json.loads(settings)).run_case("one person")
except (CheckSkipped, PhysicError):
    pass
"""


def check_leaves_home_and_network_alone(subject: BackendUnderTest) -> None:
    """`load` and `infer` request no address of a network, and write no file into the home folder of
    the user.
    """
    with suppress(CheckSkipped):  # a load that fails for want of a network
        subject.result()
    addresses = dict.fromkeys(subject.watch.places)
    hint = "Fetch weights by a command of their own: a run sends and gets nothing."
    expect(not addresses, "no network", f"a request of {', '.join(addresses)}", hint)
    module = sys.modules.get(subject.kind.__module__)
    if getattr(module, subject.kind.__qualname__, None) is not subject.kind:
        raise CheckSkipped("the home folder was not checked: the class cannot be imported")
    names = _files_in_a_new_home(subject)
    expect(
        not names,
        "no new file in the home folder",
        ", ".join(names[:3]),
        "A library may keep usage data: set its switch before you import it.",
    )


def _files_in_a_new_home(subject: BackendUnderTest) -> list[str]:
    """Return the files that a new process writes into an empty home folder in which it calls the
    backend; caches of weights are those of this one.
    """
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    weights = {"HF_HOME": "huggingface", "TORCH_HOME": "torch"}
    environment = {name: str(caches / folder) for name, folder in weights.items()} | os.environ
    target = f"{subject.kind.__module__}:{subject.kind.__qualname__}"
    options = subject.options_for(subject.case("one person")).model_dump(mode="json")
    settings = {"options": options, "device": subject.device}
    with TemporaryDirectory() as home:
        folders = {
            "HOME": home,
            "XDG_CACHE_HOME": f"{home}/.cache",
            "PHYSIC_WEIGHTS": os.pathsep.join(map(str, search_folders())),
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        subprocess.run(
            [
                *(sys.executable, "-P", "-c", _IN_A_NEW_HOME),
                *(target, subject.interface, *map(str, subject.size), json.dumps(settings)),
            ],
            env=environment | folders,
            capture_output=True,
            check=False,
        )
        return sorted(
            str(path.relative_to(home)) for path in Path(home).rglob("*") if path.is_file()
        )


def check_leaves_nothing_behind(subject: BackendUnderTest) -> None:
    """Calls write no file into the current folder and print nothing; later calls need no more
    memory.
    """
    subject.result()
    names = sorted(subject.watch.files)
    text = subject.watch.printed.strip()
    expect_or_warn(not names, "no new file in the current folder", ", ".join(names[:3]))
    expect_or_warn(
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
    expect_or_warn(
        leak <= MAX_LEAK_MB,
        f"memory that stays the same over {CALLS} calls with one photo",
        f"{leak:.1f} MB more with each call",
        "Does it keep inputs, outputs or tensors with their gradients in a list, or a cache?",
    )


CHECKS: tuple[Check, ...] = (
    Check(check_changes_no_settings_of_the_process),
    Check(check_leaves_home_and_network_alone, after=("constructs_quickly_and_offline",)),
    Check(check_leaves_nothing_behind, after=("output_depends_on_the_photo_alone",)),
)
"""Checks that run last; what is left behind is a warning."""
