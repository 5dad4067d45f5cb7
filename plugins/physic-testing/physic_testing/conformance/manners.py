"""What calls of a backend leave behind in the process: seeds, threads, switches, files, printed text and memory."""

from __future__ import annotations

import gc
import os
import random
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.field_comparison import named_values
from physic_testing.conformance.network_and_memory import resident_megabytes

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

CALLS = 20
"""Calls with one photo, over which memory is measured."""

MAX_LEAK_MB = 0.3
"""Growth of the memory per call that is taken for none: allocators keep some of what is freed."""

MAX_LEAK_SECONDS = 0.5
"""CPU time for these calls, s. Slower backends are called again only if the memory grew in the calls before."""

MAX_KEPT_MB = 1.0
"""Arrays and tensors that a closed backend may hold, MB."""

_WARM_CALLS = 4
_LEAK = "Does it keep inputs, outputs or tensors with their gradients in a list, or a cache without a bound?"


class Watch:
    """Record of what the watched calls changed in the process.

    Attributes:
        changed: settings of the process -> their change, in words.
        files: names that appeared in the current folder.
        printed: text that was written to the standard output.
        growth: memory that each call took beyond its result, MB.
        seconds: CPU time of each call, s.
        kept_mb: arrays that the backend held after ``close``, MB; None if it was not measured.
        after_one_call: bytes of each array that another instance held after its first call; None as before.
    """

    def __init__(self) -> None:
        self.changed: dict[str, str] = {}
        self.files: set[str] = set()
        self.printed = ""
        self.growth: list[float] = []
        self.seconds: list[float] = []
        self.kept_mb: float | None = None
        self.after_one_call: dict[int, int] | None = None

    @contextmanager
    def call(self) -> Iterator[list[Any]]:
        """Watch a call of ``infer``; append its result to the yielded list."""
        results: list[Any] = []
        before, names, memory = _settings(), _names(), resident_megabytes()
        output, start = _Copied(sys.stdout), time.process_time()
        try:
            with redirect_stdout(output):
                yield results
        finally:
            self.seconds.append(time.process_time() - start)
            held = sum(v.nbytes for r in results for _, v in named_values(r) if isinstance(v, np.ndarray)) / 1e6
            self.growth.append(resident_megabytes() - memory - held)
            self.printed += output.text
            self.files |= _names() - names
            for name, value in _settings().items():
                if name in before and before[name] != value:
                    self.changed.setdefault(name, f"{before[name]} -> {value}")


class _Copied:
    """A stream that keeps a copy of the text."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self.text = stream, ""

    def write(self, text: str) -> int:
        self.text += text
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _settings() -> dict[str, Any]:
    """Return the settings of the process that a call must not change; those of packages that are imported."""
    found: dict[str, Any] = {
        "random": hash(random.getstate()),
        "numpy.random": hash(_numpy_state()),
        "the current folder": os.getcwd(),
    }
    torch, cv2 = sys.modules.get("torch"), sys.modules.get("cv2")
    if torch is not None:
        found["torch's generator"] = hash(torch.get_rng_state().numpy().tobytes())
        found["torch's threads"] = torch.get_num_threads()
        found["torch's gradient mode"] = torch.is_grad_enabled()
        found["torch's default dtype"] = torch.get_default_dtype()
    if cv2 is not None:
        found["OpenCV's threads"] = cv2.getNumThreads()
    return found


def _numpy_state() -> bytes:
    """Return the state of numpy's global generator."""
    state: Any = np.random.get_state(legacy=False)["state"]
    return bytes(state["key"].tobytes() + state["pos"].to_bytes(4, "little"))


def _names() -> set[str]:
    return set(os.listdir())


def held_arrays(thing: Any) -> dict[int, int]:
    """Return the bytes of the arrays, tensors and networks that an object holds in its attributes, by their id."""
    from physic_testing.conformance.attributes import attribute_values

    sizes: dict[int, int] = {}
    for value in attribute_values(thing).values():
        if isinstance(getattr(value, "nbytes", None), int):
            sizes[id(value)] = value.nbytes
        elif callable(getattr(value, "parameters", None)) and hasattr(value, "state_dict"):
            sizes |= {id(p): p.nbytes for p in value.parameters()}
    return sizes


def check_changes_no_settings_of_the_process(subject: BackendUnderTest) -> None:
    """Calls leave seeds, threads, switches and the current folder as they were."""
    subject.result()
    names = sorted(subject.watch.changed)
    expect(
        not names,
        "random generators, threads, switches and current folder as before the call",
        f"other values of {', '.join(names)}",
        "Use generators of your own, np.random.default_rng(seed) or torch.Generator, and options of the session for "
        "threads; use `with torch.no_grad()`.",
    )


def check_writes_no_files(subject: BackendUnderTest) -> None:
    """Calls write no file into the current folder, which is the user's."""
    subject.result()
    names = sorted(subject.watch.files)
    expect(not names, "no new file in the current folder", ", ".join(names[:3]), "Write where an option says.")


def check_prints_nothing(subject: BackendUnderTest) -> None:
    """Calls print nothing: the standard output belongs to the command, and may be JSON."""
    subject.result()
    text = subject.watch.printed.strip()
    expect(not text, "no text on the standard output", repr(text[:60]), "Use `logging`, or the notes of the result.")


def check_needs_no_more_memory_in_later_calls(subject: BackendUnderTest) -> None:
    """Twenty calls with one photo need no more memory than a few: nothing piles up."""
    from physic_testing.conformance.backend_under_test import FIRST_PHOTO

    subject.result(FIRST_PHOTO)
    case, backend = subject.case(FIRST_PHOTO), subject.loaded(subject.case(FIRST_PHOTO))
    held, once, calls = held_arrays(backend), subject.watch.after_one_call, len(subject.case_runs)
    if once is not None and len(held) - len(once) >= calls - 1:
        leak = (sum(held.values()) - sum(once.values())) / 1e6 / calls
        expect(leak <= MAX_LEAK_MB, "arrays that do not pile up", f"{leak:.1f} MB more with each call", _LEAK)
    grew = float(np.median(subject.watch.growth[_WARM_CALLS:])) if len(subject.watch.growth) > _WARM_CALLS else 0.0
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
    Check(check_changes_no_settings_of_the_process, _BACKEND, warns=True),
    Check(check_writes_no_files, _BACKEND, warns=True),
    Check(check_prints_nothing, _BACKEND, warns=True),
    Check(check_needs_no_more_memory_in_later_calls, _BACKEND, warns=True, after=("keeps_no_state_between_photos",)),
    Check(check_close_releases_memory, _BACKEND, warns=True, after=("works_again_after_close",)),
)
"""Checks of manners, which warn; they run last."""
