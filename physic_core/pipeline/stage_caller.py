"""Load backends once and keep them; run the stages of a reconstruction, check their results,
measure times.
"""

from __future__ import annotations

import copy
import gc
import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from typing import TYPE_CHECKING, cast

from physic_core import errors
from physic_core.backends.devices import check_device
from physic_core.cache.kit_stamps import has_passed_kit, target_of
from physic_core.cache.results import canonicalize, network_results_in
from physic_core.configuration.resolve import resolve_one
from physic_core.discovery.error_text import (
    bounded_message,
    describe_error,
    left_out_warning,
    plugin_error,
    traceback_text,
)
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.process_state import restored_process_state
from physic_core.errors import BackendError, BackendOutputError, PhysicError
from physic_core.interfaces.backend import Result, call, contract_violations, interface_of
from physic_core.interfaces.checks import require_image
from physic_core.interfaces.comparison import describe_difference
from physic_core.pipeline.plausibility import implausibilities, repetition_warnings
from physic_core.types import StageRecord

if TYPE_CHECKING:
    from physic_core.cache.results import CacheKey, ResultCache
    from physic_core.configuration.resolve import ResolvedBackend
    from physic_core.interfaces import Backend, Request
    from physic_core.types import UInt8Array

_LOG = logging.getLogger(__name__)

Progress = Callable[[str, int, int], None]
"""Called at the start of a stage with its name, its number from 0, and the number of stages."""


@dataclass(eq=False, repr=False)
class StageCaller:
    """Runs the stages of one reconstruction, and records times, warnings and notes.

    Attributes:
        device: torch device of the backends.
        total: number of stages.
        progress: called when each stage begins.
        cache: results of earlier runs; every backend is called if None.
        low_memory: close each backend right after its last use, and collect garbage then: networks
            often have reference cycles.
        close_used: close each backend right after its last use; collecting garbage would take .1 s
            each time.
        loaded: backends that earlier photos have loaded, on the same device; none if None.
        records: the stages that have run so far.
        files: weight files of the backends that were called, by "set/file".
        warnings: reasons why the result may be wrong, one sentence each.
        notes: how results were obtained, one sentence each.
    """

    device: str
    total: int
    progress: Progress | None = None
    _: KW_ONLY
    cache: ResultCache | None = None
    low_memory: bool = False
    close_used: bool = False
    loaded: LoadedBackends | None = None
    records: list[StageRecord] = field(default_factory=list, init=False)
    warnings: list[str] = field(default_factory=list, init=False)
    notes: list[str] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._loaded = self.loaded or LoadedBackends(self.device)

    def warn(self, *texts: str) -> None:
        """Add warnings, without duplicates."""
        self.warnings += [t for t in dict.fromkeys(texts) if t not in self.warnings]

    def note(self, *texts: str) -> None:
        """Add notes, without duplicates."""
        self.notes += [t for t in dict.fromkeys(texts) if t not in self.notes]

    def warn_of_error(self, error: PhysicError, otherwise: str) -> None:
        """Add a warning of an error, which ends with what the run does ``otherwise``, and print its
        traceback on stderr if ``PHYSIC_DEBUG`` is set.
        """
        self.warn(f"{' '.join(str(error).split())}; {otherwise}")
        if trace := traceback_text(error):
            sys.stderr.write(trace)

    @contextmanager
    def optional_step(self, what: str) -> Iterator[None]:
        """Turn an error in the block into a warning that begins with ``what``: the result is
        complete without it.
        """
        try:
            yield
        except Exception as error:
            self.warn(left_out_warning(what, error))
            if trace := traceback_text(error):
                sys.stderr.write(trace)

    @contextmanager
    def time_engine(self, name: str) -> Iterator[None]:
        """Measure the time of one stage of the engine."""
        self._report_progress(name)
        start = time.perf_counter()
        yield
        self.records.append(StageRecord(name, time.perf_counter() - start))

    def call_backend(
        self, name: str, resolved: ResolvedBackend, request: Request[Result], *, last: bool = True
    ) -> Result:
        """Call a backend and check its result, or read the result from the cache.

        Args:
            name: of the stage.
            resolved: the backend; loaded at its first call.
            request: of the backend's interface.
            last: whether this is the last call of the backend in this run.

        Returns:
            The checked result.

        Raises:
            InputError: the image of ``request`` is not a valid photo; the backend is not loaded.
            BackendError: the backend raised an error that is not a PhysicError of the core.
            PhysicError: the backend refused the request; the backend chooses the class, the message
                names the backend.
            BackendOutputError: the backend returned an invalid result.
        """
        require_image(request.image)
        self._report_progress(name)
        interface = interface_of(type(resolved.backend))
        title = f"{resolved.title}, stage '{name}'"
        start = time.perf_counter()
        loading = 0.0
        cached = False
        failed = True

        find_faults = partial(contract_violations, interface, request=request)
        try:
            key = self._cache_key(title, resolved, request.arguments_read(resolved.backend.reads))
            result = self._read_cache(key, find_faults)
            cached = result is not None
            if result is None:
                loading = self._loaded.load(resolved, title, self.warn)
                start = time.perf_counter()
                with wrap_plugin_errors(title, resolved, self.warn), network_results_in(self.cache):
                    # A copy: the backend may write to its input, and later stages get the same
                    # arrays.
                    result = call(resolved.backend, copy.deepcopy(request))
                if found := find_faults(result):
                    message = f"{title} returned what the interface does not allow:\n  "
                    raise BackendOutputError(message + "\n  ".join(found))
                with wrap_plugin_errors(title, resolved):
                    result = canonicalize(result)  # the backend may write to its arrays later
            seconds = time.perf_counter() - start
            failed = False
            agrees = False
            with self.optional_step(f"{resolved.title}: the search for mistakes"):
                agrees = self._warn_of_doubts(resolved, request, result, called=not cached)
            if key is not None and not cached and agrees:
                assert self.cache is not None
                self.cache.write(key, result)
        finally:
            if failed:
                seconds = time.perf_counter() - start
            self.records.append(
                StageRecord(name, seconds, loading, resolved.provenance, cached, failed)
            )
            if (self.close_used or self.low_memory) and last:
                self.close_backend(resolved)
                if self.low_memory:
                    gc.collect()
        return cast("Result", result)

    def has_passed_kit(self, resolved: ResolvedBackend) -> bool:
        """Return whether a backend ships with the project, or has passed the conformance kit."""
        return self._loaded.has_passed_kit(resolved)

    def _warn_of_doubts(
        self, resolved: ResolvedBackend, request: Request[Result], result: object, *, called: bool
    ) -> bool:
        """Warn of what makes a result doubtful, unless the backend has passed the kit; return
        whether the backend answers its first question twice in the same way.
        """
        if self.has_passed_kit(resolved):
            return True
        interface = resolved.provenance.interface
        doubts = list(implausibilities(interface, request, result))
        differs = ""
        capabilities = getattr(resolved.backend, "capabilities", ())
        last = self._loaded.last.get(id(resolved.backend))
        if called:
            self._loaded.last[id(resolved.backend)] = request.image, result
        if called and last is not None and "ignores_image" not in capabilities:
            doubts += repetition_warnings(interface, *last, request.image, result)
        if called and last is None and "stochastic" not in capabilities:
            with wrap_plugin_errors(resolved.title, resolved, self.warn), network_results_in(None):
                again = canonicalize(call(resolved.backend, copy.deepcopy(request)))
            if differs := describe_difference(result, again):
                doubts.append(f"two calls give different answers ({differs}): is dropout on?")
        self.warn(*(f"{resolved.title}: {doubt}" for doubt in doubts))
        return not differs

    def trim_cache(self) -> None:
        """Trim the cache and collect its notes; the backends stay loaded."""
        if self.cache is not None:
            self.cache.trim()
            self.note(*self.cache.notes)

    def close(self) -> None:
        """Close all loaded backends and trim the cache; a backend that cannot be closed adds a
        warning.
        """
        self.close_backend()
        self.trim_cache()

    def _report_progress(self, name: str) -> None:
        if self.progress is not None:
            self.progress(name, len(self.records), self.total)

    def close_backend(self, *only: ResolvedBackend) -> None:
        """Close these backends, or all; one that cannot be closed adds a warning."""
        for error in self._loaded.close(*only, report=self.warn):
            self.warn_of_error(error, "the result is complete, but memory may leak")

    def _cache_key(
        self, title: str, resolved: ResolvedBackend, inputs: tuple[object, ...]
    ) -> CacheKey | None:
        if self.cache is None or not resolved.cacheable:
            return None
        with (
            self.optional_step(f"{resolved.title}: its key of the cache"),
            wrap_plugin_errors(title, resolved, self.warn),
        ):
            return self.cache.key(resolved.backend, resolved.provenance, self.device, inputs)
        return None

    def _read_cache(
        self, key: CacheKey | None, find_faults: Callable[[object], list[str]]
    ) -> object | None:
        if self.cache is None or key is None:
            return None
        result = self.cache.read(key)
        if result is not None and (found := find_faults(result)):
            self.cache.discard(key, found[0])
            return None
        return result


class LoadedBackends:
    """The backends of a pipeline that are loaded on one device.

    Attributes:
        last: image and result of the last call of each backend that never passed the kit, by its
            id.
    """

    def __init__(self, device: str) -> None:
        self.last: dict[int, tuple[UInt8Array, object]] = {}
        self._device = device
        self._loaded: dict[int, ResolvedBackend] = {}
        self._ready: set[int] = set()
        self._vouched: dict[int, bool] = {}

    def has_passed_kit(self, resolved: ResolvedBackend) -> bool:
        """Return whether a backend ships with the project, or has passed the conformance kit."""
        key = id(resolved.backend)
        if key not in self._vouched:
            self._vouched[key] = has_passed_kit(
                resolved.provenance.interface, target_of(type(resolved.backend)), resolved.backend
            )
        return self._vouched[key]

    def load(
        self,
        resolved: ResolvedBackend,
        title: str = "",
        report: Callable[[str], None] = _LOG.warning,
    ) -> float:
        """Load a backend unless it is loaded, and return the seconds taken.

        A backend whose ``load`` failed earlier is closed and reloaded.

        Args:
            resolved: the backend.
            title: start of messages; names the backend if empty.
            report: receives a sentence if the backend changes the state of the process.

        Raises:
            PhysicError: the backend cannot be loaded.
        """
        start = time.perf_counter()
        key = id(resolved.backend)
        if key not in self._ready:
            self.close(resolved)
            self._loaded[key] = resolved  # before loading: a half-loaded backend is closed too
            title = title or f"{resolved.title} cannot be loaded"
            with wrap_plugin_errors(title, resolved, report):
                resolved.backend.load(self._device)
            self._ready.add(key)
        return time.perf_counter() - start

    def close(
        self, *only: ResolvedBackend, report: Callable[[str], None] = _LOG.warning
    ) -> list[PhysicError]:
        """Close these backends, or all; return the errors of those that cannot be closed.

        Args:
            only: the backends; all if none is given.
            report: receives a sentence for a backend that changes the state of the process.
        """
        failed = []
        for resolved in only or tuple(self._loaded.values()):
            self._ready.discard(id(resolved.backend))
            if self._loaded.pop(id(resolved.backend), None) is not None:
                try:
                    with wrap_plugin_errors(f"{resolved.title} cannot be closed", resolved, report):
                        resolved.backend.close()
                except PhysicError as error:
                    failed.append(error)
        return failed


def load_backend(
    interface: str, name: str, /, *, device: str = "cpu", **options: object
) -> Backend:
    """Load a single backend, to call it directly: ``load_backend("inpainter", "telea")(image,
    mask)``.

    Its arguments are those of ``infer``. ``close`` releases its memory.

    Args:
        interface: "metric_depth", ...
        name: as in a configuration: "name", "distribution:name", or "package.module:Class".
        device: "cpu", "cuda" or "cuda:N".
        options: of the backend.

    Raises:
        ConfigError: the interface, the name or the options are invalid; the message lists all
            errors.
        WeightsMissingError: files of the backend are missing.
        DeviceError: the device does not exist.
        BackendError: the backend cannot be imported, constructed or loaded.
    """
    resolved = resolve_one(interface, name, options)
    check_device(device)
    LoadedBackends(device).load(resolved)
    return resolved.backend


@contextmanager
def wrap_plugin_errors(
    title: str,
    resolved: ResolvedBackend,
    report: Callable[[str], None] | None = None,
) -> Iterator[None]:
    """Run code of a backend: its exceptions become PhysicErrors, and the settings of
    :mod:`physic_core.discovery.process_state` stay as they were.

    Args:
        title: start of the messages of errors: names the backend, and the stage or what failed.
        resolved: the backend.
        report: receives a sentence for each setting that the backend changed, which is restored.
            None for code that only touches what the backend returned: no state is kept.

    Raises:
        PhysicError: of the class that the backend raised, or BackendError; its message starts with
            ``title``.
    """
    changes: list[str] = []
    try:
        with (
            nullcontext(changes) if report is None else restored_process_state() as changes,
            plugin_code(),
        ):
            yield
    except PhysicError as error:
        kind = type(error)
        # other classes may need other arguments
        known = kind if kind.__module__ == errors.__name__ else BackendError
        raise known(f"{title}: {bounded_message(error)}") from error
    except Exception as cause:
        raise BackendError(
            f"{title}: {describe_error(cause, type(resolved.backend))}"
        ) from plugin_error(cause)
    finally:
        if report is not None:
            for change in changes:
                report(f"{resolved.title} {change}")
