"""Record of what calls of a backend change in the process: seeds, threads, switches, files, printed
text, memory.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from physic_core.discovery.process_state import kept_process_state
from physic_testing.conformance.field_comparison import named_values
from physic_testing.conformance.network_and_memory import resident_megabytes

if TYPE_CHECKING:
    from physic_core.discovery.process_state import Change


class Watch:
    """Record of what the watched calls changed in the process.

    Attributes:
        changed: names of settings of the process -> name and values.
        files: names that appeared in the current folder.
        printed: text that was written to the standard output.
        growth: memory that each call took beyond its result, MB.
        seconds: CPU time of each call, s.
        kept_mb: arrays that the backend held after ``close``, MB; None if it was not measured.
        after_one_call: bytes of each array that another instance held after its first call; None as
            before.
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
    def settings(self, *, loads: bool = False) -> Iterator[None]:
        """Watch the settings of the process, and restore them."""
        changes: list[Change] = []
        try:
            with kept_process_state(loads=loads) as changes:
                yield
        finally:
            self.changed |= {change.name: change.text for change in changes}

    @contextmanager
    def load(self) -> Iterator[None]:
        """Watch a call of ``load``, with another number of torch's threads: an earlier load may
        have set its own.
        """
        torch = sys.modules.get("torch")
        if torch is None:
            with self.settings(loads=True):
                yield
            return
        threads = torch.get_num_threads()
        torch.set_num_threads(threads + 1)
        try:
            with self.settings(loads=True):
                yield
        finally:
            torch.set_num_threads(threads)

    @contextmanager
    def call(self) -> Iterator[list[Any]]:
        """Watch a call of ``infer``; append its result to the yielded list."""
        results: list[Any] = []
        names = _names()
        memory = resident_megabytes()
        output = _Copied(sys.stdout)
        start = time.process_time()
        try:
            with redirect_stdout(output), self.settings():
                yield results
        finally:
            self.seconds.append(time.process_time() - start)
            held = (
                sum(
                    v.nbytes
                    for r in results
                    for _, v in named_values(r)
                    if isinstance(v, np.ndarray)
                )
                / 1e6
            )
            self.growth.append(resident_megabytes() - memory - held)
            self.printed += output.text
            self.files |= _names() - names


class _Copied:
    """A stream that keeps a copy of the text."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.text = ""

    def write(self, text: str) -> int:
        self.text += text
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _names() -> set[str]:
    return set(os.listdir())
