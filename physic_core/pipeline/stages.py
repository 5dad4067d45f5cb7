"""Runs the stages of one reconstruction: loads backends when first asked, times them, checks what they answer."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from physic_core import errors
from physic_core.discovery.error_text import describe, traceback_text
from physic_core.errors import BackendError, BackendOutputError, PhysicError
from physic_core.pipeline.image_check import check_photo, infer
from physic_core.pipeline.validation import tensor_advice
from physic_core.types import StageRecord

if TYPE_CHECKING:
    from physic_core.cache.answers import Answers, Question
    from physic_core.configuration.resolve import ResolvedBackend

__all__ = ["Progress", "Stages"]

Answer = TypeVar("Answer")
Faults = Callable[[Answer], list[str]]
Progress = Callable[[str, int, int], None]
"""Called with a stage's name, its number from 0, and how many there are, as the stage begins."""


class Stages:
    """The record of one run.

    Attributes:
        records: what has run so far.
        warnings: what the user should doubt, in plain words, each once.
        notes: how the numbers came about, in plain words, each once.
    """

    def __init__(
        self,
        device: str,
        total: int,
        progress: Progress | None = None,
        *,
        answers: Answers | None = None,
        low_memory: bool = False,
    ) -> None:
        """
        Args:
            device: where backends are loaded.
            total: how many stages there will be.
            progress: told when each begins.
            answers: of earlier runs; every backend is asked where None.
            low_memory: close each backend right after its last use.
        """
        self.records: list[StageRecord] = []
        self.warnings: list[str] = []
        self.notes: list[str] = []
        self._device = device
        self._total = total
        self._progress = progress
        self._answers = answers
        self._low_memory = low_memory
        self._loaded: dict[int, ResolvedBackend] = {}

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
        inputs: tuple[object, ...],
        expect: type[Answer],
        faults: Faults[Answer],
        *,
        again: bool = False,
    ) -> Answer:
        """Ask one backend, or find what it answered to the same in an earlier run.

        Args:
            name: of the stage.
            resolved: the backend; it is loaded if it is not yet.
            inputs: arguments of its ``infer``.
            expect: what the answer must be an instance of.
            faults: what else is wrong with an answer.
            again: whether the backend will be asked once more.

        Raises:
            InputError: the first of ``inputs`` is no photo; the backend is not loaded.
            BackendError: the backend failed, with something that is not a PhysicError of ours.
            PhysicError: the backend refused; the class is its own, and the message names it.
            BackendOutputError: it answered what its interface does not allow.
        """
        check_photo(inputs[0])
        self._begin(name)
        title = f"{resolved.title}, stage '{name}'"
        start, loading, cached, failed = time.perf_counter(), 0.0, False, True
        try:
            question = self._question(title, resolved, inputs)
            answer = self._remembered(question, expect, faults)
            cached = answer is not None
            if answer is None:
                with _door(title, resolved):
                    loading = self._load(resolved)
                    start = time.perf_counter()
                    given = infer(resolved.backend, inputs)
                answer = self._accepted(title, given, expect, faults)
            seconds, failed = time.perf_counter() - start, False
            if question is not None and not cached:
                assert self._answers is not None
                self._answers.keep(question, answer)
        finally:
            if failed:
                seconds = time.perf_counter() - start
            self.records.append(StageRecord(name, seconds, loading, resolved.provenance, cached, failed))
            if self._low_memory and not again:
                self._close(resolved)
                gc.collect()  # networks tend to hold themselves
        return answer

    def ask_if_it_can(
        self,
        name: str,
        resolved: ResolvedBackend,
        inputs: tuple[object, ...],
        expect: type[Answer],
        faults: Faults[Answer],
        *,
        otherwise: str,
    ) -> Answer | None:
        """:meth:`ask` a backend that the run can do without: where it fails, warn and answer None.

        Args:
            otherwise: what is done without it, in words that end the warning.
        """
        try:
            return self.ask(name, resolved, inputs, expect, faults)
        except PhysicError as error:
            self.warn(f"{_one_line(error)}; {otherwise}")
            _print_traceback(error)
            return None

    def close(self) -> None:
        """Close every backend that is loaded, and leave the cache in order; a backend that cannot costs a warning."""
        for resolved in list(self._loaded.values()):
            self._close(resolved)
        if self._answers is not None:
            self._answers.tidy()
            self.note(*self._answers.notes)

    def _begin(self, name: str) -> None:
        if self._progress is not None:
            self._progress(name, len(self.records), self._total)

    def _load(self, resolved: ResolvedBackend) -> float:
        """Load a backend if it is not yet, and answer how long it took, s."""
        start = time.perf_counter()
        if id(resolved.backend) not in self._loaded:
            self._loaded[id(resolved.backend)] = resolved  # before: what is half loaded is closed too
            resolved.backend.load(self._device)
        return time.perf_counter() - start

    def _close(self, resolved: ResolvedBackend) -> None:
        if self._loaded.pop(id(resolved.backend), None) is None:
            return
        try:
            with _door(f"{resolved.title} cannot be closed", resolved):
                resolved.backend.close()
        except PhysicError as error:
            self.warn(f"{_one_line(error)}; the result is whole, but memory may be lost")
            _print_traceback(error)

    def _question(self, title: str, resolved: ResolvedBackend, inputs: tuple[object, ...]) -> Question | None:
        if self._answers is None:
            return None
        with _door(title, resolved):
            return self._answers.question(resolved.backend, resolved.provenance, self._device, inputs)

    def _remembered(self, question: Question | None, expect: type[Answer], faults: Faults[Answer]) -> Answer | None:
        if self._answers is None or question is None:
            return None
        answer = self._answers.find(question)
        if answer is None:
            return None
        wrong = _wrong(answer, expect, faults)
        if wrong:
            self._answers.drop(question, wrong[0])
            return None
        assert isinstance(answer, expect)
        return answer

    def _accepted(self, title: str, answer: object, expect: type[Answer], faults: Faults[Answer]) -> Answer:
        from physic_core.cache.answers import canonical

        wrong = _wrong(answer, expect, faults)
        if wrong:
            raise BackendOutputError(f"{title} answered what the interface does not allow:\n  " + "\n  ".join(wrong))
        assert isinstance(answer, expect)
        return canonical(answer)


@contextmanager
def _door(title: str, resolved: ResolvedBackend) -> Iterator[None]:
    """A plugin's door: whatever comes out of it says who failed where."""
    try:
        yield
    except PhysicError as error:
        kind = type(error)
        known = kind if kind.__module__ == errors.__name__ else BackendError  # another class may want other arguments
        raise known(f"{title}: {error}") from error
    except (Exception, SystemExit) as cause:
        raise BackendError(f"{title}: {describe(cause, type(resolved.backend))}") from cause


def _wrong(answer: object, expect: type[Answer], faults: Faults[Answer]) -> list[str]:
    if not isinstance(answer, expect):
        return [f"expected {expect.__name__}, got {type(answer).__name__}{tensor_advice(answer)}"]
    try:
        return faults(answer)
    except Exception as cause:  # fields of kinds that nobody thought of
        return [f"{expect.__name__} cannot be read: {type(cause).__name__}: {cause}"]


def _print_traceback(error: Exception) -> None:
    """On stderr, where ``PHYSIC_DEBUG`` asks for it: the run goes on, so that nobody else shows it."""
    if trace := traceback_text(error):
        sys.stderr.write(trace)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
