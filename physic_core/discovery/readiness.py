"""Estimate whether a backend can be used on this machine, without importing it."""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass, replace
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physic_core.discovery.local_modules import split_folder
from physic_core.discovery.plugin_code import named_plugin_code
from physic_core.errors import BackendError, WeightsMissingError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_core.discovery.registry import BackendOffer, Registry
    from physic_core.interfaces import Backend

_State = Literal["ready", "unsure", "not ready", "ambiguous", "refused", "broken"]

_GPU = ("gpu", "cuda")
_WEIGHTS = "weights"
_DRIVER_PATHS = ("/proc/driver/nvidia/version", "/dev/nvidiactl", "/dev/dxg")


@dataclass(frozen=True)
class Readiness:
    """Estimated usability of a backend on this machine.

    Attributes:
        word: "ready" if the file of its module, its packages and its weights exist; "unsure" if only loading it can
            show; "not ready" if a package, weights or a GPU are missing; "ambiguous" if its distribution offers the
            name twice; "refused" if the record is invalid; "broken" if its package does not exist.
        why: the reason; may be empty if the backend is ready.
    """

    word: _State
    why: str = ""

    def __str__(self) -> str:
        word = self.word if self.word in ("ready", "unsure") else self.word.upper()
        return f"{word}: {self.why}" if self.why else word


def readiness(
    registry: Registry,
    offer: BackendOffer,
    gpu: Callable[[], bool] | None = None,
    missing_sets: Callable[[Registry, BackendOffer], Sequence[str] | None] | None = None,
) -> Readiness:
    """Check whether the module, packages, GPU and weights that a backend needs are available.

    Args:
        registry: registry that contains the backend.
        offer: the backend.
        gpu: returns whether there is a GPU; None for :func:`has_gpu`.
        missing_sets: returns missing weights, as :func:`physic_core.weights.library.missing_sets`; None skips them.
    """
    if offer.problem:
        return Readiness("refused", offer.problem)
    rivals = registry.with_same_name(offer)
    if twins := [rival for rival in rivals if rival.origin.distribution == offer.origin.distribution]:
        return Readiness("ambiguous", registry.explain_ambiguity((offer, *twins)))
    found = _readiness(registry, offer, gpu, missing_sets)
    if not rivals:
        return found
    others = " and ".join(dict.fromkeys(rival.origin.distribution for rival in rivals))
    name = f"{offer.origin.distribution}:{offer.record.name}"
    return replace(found, why="; ".join(filter(None, (found.why, f"{others} offers this name too: write '{name}'"))))


def _readiness(
    registry: Registry,
    offer: BackendOffer,
    gpu: Callable[[], bool] | None,
    missing_sets: Callable[[Registry, BackendOffer], Sequence[str] | None] | None,
) -> Readiness:
    """Return the readiness of a backend with a valid and unique record."""
    record = offer.record
    module = split_folder(record.target)[1].partition(":")[0] if isinstance(record.target, str) else None
    if module is not None and not is_installed(module.partition(".")[0]):
        return Readiness("broken", f"there is no module '{module}' for its target {record.target}")
    faults = []
    if uninstalled := [package for package in record.packages if not is_installed(package)]:
        faults.append(f"not installed: {', '.join(uninstalled)}")
    further = [need for need in record.needs if need.lower() not in _GPU]
    if len(further) < len(record.needs) and not (gpu or has_gpu)():
        faults.append("no GPU is found")
    sets = missing_sets(registry, offer) if missing_sets is not None else None
    if sets:
        faults.append(f"missing: {', '.join(sets)}")
    if faults:
        return Readiness("not ready", "; ".join(faults))
    if sets is not None:
        further = [need for need in further if need != _WEIGHTS]
    doubts = [f"needs {', '.join(further)}"] if further else []
    if sets is None and record.weights and missing_sets is not None:
        doubts.append(f"no manifest of its plugin lists all of the weights {', '.join(record.weights)}")
    if module is not None and not is_installed(module):
        doubts.append(f"no file of the module '{module}' is found")
    if doubts:
        return Readiness("unsure", f"{'; '.join(doubts)}; `physic plugins doctor {record.name}` checks it")
    return Readiness("ready")


def missing_requirements(backend: Backend) -> tuple[str, ...]:
    """Call ``missing()`` of a backend, and return its messages about missing requirements.

    Raises:
        BackendError: ``missing()`` fails, or does not return texts.
        PhysicError: raised by the backend itself.
    """
    try:
        with named_plugin_code("missing() fails", type(backend)):
            messages: object = backend.missing()
    except WeightsMissingError as error:
        return (str(error),)
    if not isinstance(messages, (tuple, list)) or not all(isinstance(text, str) for text in messages):
        raise BackendError(f"missing() must return a tuple of texts, got {messages!r}")
    return tuple(messages)


def has_gpu() -> bool:
    """Return whether an NVIDIA driver is loaded; faster than importing torch."""
    return shutil.which("nvidia-smi") is not None or any(Path(path).exists() for path in _DRIVER_PATHS)


def is_installed(module: str) -> bool:
    """Return whether the file of a module can be found; nothing is imported."""
    top, *below = module.split(".")
    try:
        spec = find_spec(top)
        for i, _ in enumerate(below):
            if spec is None or spec.submodule_search_locations is None:
                return False
            name = ".".join((top, *below[: i + 1]))
            spec = PathFinder.find_spec(name, spec.submodule_search_locations)
    except (ImportError, ValueError, AttributeError):  # a module in sys.modules has no spec
        return module in sys.modules
    return spec is not None
