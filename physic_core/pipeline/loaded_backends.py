"""Load each backend once, keep it for further photos, and close it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from physic_core import errors
from physic_core.adapters.devices import check_device
from physic_core.configuration.resolve import resolve_one
from physic_core.discovery.plugin_code import plugin_code, plugin_error
from physic_core.errors import BackendError, PhysicError
from physic_core.weights.lock import FileUse, recorded_uses

if TYPE_CHECKING:
    from physic_core.configuration.resolve import ResolvedBackend
    from physic_core.interfaces import Backend


class LoadedBackends:
    """The backends of a pipeline that are loaded on one device."""

    def __init__(self, device: str) -> None:
        self._device = device
        self._loaded: dict[int, ResolvedBackend] = {}
        self._ready: set[int] = set()
        self._uses: dict[int, dict[str, FileUse]] = {}

    def load(self, resolved: ResolvedBackend) -> float:
        """Load a backend unless it is loaded, and return the seconds taken.

        A backend whose ``load`` failed earlier is closed and reloaded.
        """
        start, key = time.perf_counter(), id(resolved.backend)
        if key not in self._ready:
            self.close(resolved)
            self._loaded[key] = resolved  # before loading: a half-loaded backend is closed too
            with recorded_uses() as uses:
                resolved.backend.load(self._device)
            self._uses[key] = uses
            self._ready.add(key)
        return time.perf_counter() - start

    def files_of(self, resolved: ResolvedBackend) -> Mapping[str, FileUse]:
        """Return the weight files that a loaded backend read."""
        return self._uses.get(id(resolved.backend), {})

    def close(self, *only: ResolvedBackend) -> list[PhysicError]:
        """Close these backends, or all; return the errors of those that cannot be closed."""
        failed = []
        for resolved in only or tuple(self._loaded.values()):
            self._ready.discard(id(resolved.backend))
            if self._loaded.pop(id(resolved.backend), None) is not None:
                try:
                    with wrap_plugin_errors(f"{resolved.title} cannot be closed", resolved):
                        resolved.backend.close()
                except PhysicError as error:
                    failed.append(error)
        return failed


def load_backend(interface: str, name: str, /, *, device: str = "cpu", **options: object) -> Backend:
    """Load a single backend, to call it directly: ``load_backend("inpainter", "telea")(image, mask)``.

    Its arguments are those of ``infer``. ``close`` releases its memory.

    Args:
        interface: "metric_depth", ...
        name: as in a configuration: "name", "distribution:name", or "package.module:Class".
        device: "cpu", "cuda" or "cuda:N".
        options: of the backend.

    Raises:
        ConfigError: the interface, the name or the options are invalid; the message lists all errors.
        WeightsMissingError: files of the backend are missing.
        DeviceError: the device does not exist.
        BackendError: the backend cannot be imported, constructed or loaded.
    """
    resolved = resolve_one(interface, name, options)
    check_device(device)
    with wrap_plugin_errors(f"{resolved.title} cannot be loaded", resolved):
        LoadedBackends(device).load(resolved)
    return resolved.backend


@contextmanager
def wrap_plugin_errors(title: str, resolved: ResolvedBackend) -> Iterator[None]:
    """Convert every exception of a plugin to a PhysicError that names the backend and the stage."""
    try:
        with plugin_code():
            yield
    except PhysicError as error:
        from physic_core.discovery.error_text import message_of

        kind = type(error)
        known = kind if kind.__module__ == errors.__name__ else BackendError  # other classes may need other arguments
        raise known(f"{title}: {message_of(error)}") from error
    except Exception as cause:
        from physic_core.discovery.error_text import describe_error

        raise BackendError(f"{title}: {describe_error(cause, type(resolved.backend))}") from plugin_error(cause)
