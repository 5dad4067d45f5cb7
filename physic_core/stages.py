"""Runs the stages of one reconstruction: loads backends when first asked, times them, checks what they answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from physic_core.errors import BackendError, BackendOutputError, PhysicError
from physic_core.types import StageRecord

if TYPE_CHECKING:
    from physic_core.resolve import ResolvedBackend

__all__ = ["Progress", "Stages"]

Answer = TypeVar("Answer")
Progress = Callable[[str, int, int], None]
"""Called with a stage's name, its number from 0, and how many there are, as the stage begins."""


class Stages:
    """The record of one run.

    Attributes:
        records: what has run so far.
        warnings: what the user should doubt, in plain words, each once.
        notes: how the numbers came about, in plain words, each once.
    """

    def __init__(self, device: str, total: int, progress: Progress | None = None) -> None:
        self.records: list[StageRecord] = []
        self.warnings: list[str] = []
        self.notes: list[str] = []
        self._device = device
        self._total = total
        self._progress = progress
        self._loaded: set[int] = set()

    def warn(self, *texts: str) -> None:
        """Keep each warning once, in order."""
        self.warnings += [t for t in dict.fromkeys(texts) if t not in self.warnings]

    def note(self, *texts: str) -> None:
        """Keep each note once, in order."""
        self.notes += [t for t in dict.fromkeys(texts) if t not in self.notes]

    @contextmanager
    def engine(self, name: str) -> Iterator[None]:
        """Time a stage that is ours."""
        self._begin(name)
        start = time.perf_counter()
        yield
        self.records.append(StageRecord(name, time.perf_counter() - start))

    def ask(
        self,
        name: str,
        resolved: ResolvedBackend,
        call: Callable[[Any], Answer],
        expect: type[Answer],
        faults: Callable[[Answer], list[str]],
    ) -> Answer:
        """Load the backend if need be, call it, and refuse an answer of another type or with faults.

        Raises:
            BackendError: the backend failed with something that is not a PhysicError.
            BackendOutputError: it answered what its interface does not allow.
        """
        self._begin(name)
        backend, who = resolved.backend, resolved.provenance
        title = f"{resolved.title}, stage '{name}'"
        start = time.perf_counter()
        try:
            if id(backend) not in self._loaded:
                backend.load(self._device)
                self._loaded.add(id(backend))
            loaded = time.perf_counter()
            answer = call(backend)
        except PhysicError:
            raise
        except (Exception, SystemExit) as cause:  # a plugin's door
            raise BackendError(f"{title}: {type(cause).__name__}: {cause}") from cause
        done = time.perf_counter()
        if isinstance(answer, expect):
            wrong = faults(answer)
        else:
            wrong = [f"expected {expect.__name__}, got {type(answer).__name__}"]
        if wrong:
            raise BackendOutputError(f"{title} answered what the interface does not allow:\n  " + "\n  ".join(wrong))
        self.records.append(StageRecord(name, done - loaded, loaded - start, who))
        return answer

    def _begin(self, name: str) -> None:
        if self._progress is not None:
            self._progress(name, len(self.records), self._total)
