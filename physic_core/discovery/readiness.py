"""Whether a backend can be used on this machine, estimated without importing it."""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physic_core.discovery.error_text import describe
from physic_core.discovery.local_modules import split
from physic_core.errors import BackendError, PhysicError, WeightsMissingError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_core.discovery.registry import Claim, Registry
    from physic_core.interfaces import Backend

__all__ = ["Readiness", "gpu_is_seen", "missing_requirements", "readiness"]

Word = Literal["ready", "unsure", "not ready", "ambiguous", "refused", "broken"]

_GPU = ("gpu", "cuda")
_WEIGHTS = "weights"
_TRACES = ("/proc/driver/nvidia/version", "/dev/nvidiactl", "/dev/dxg")


@dataclass(frozen=True)
class Readiness:
    """Expected usability of a backend.

    Attributes:
        word: "ready"; "unsure" where only loading it can show; "not ready" where something is missing on
            this machine; "ambiguous" where its own distribution offers the name twice; "refused" and "broken" where
            no config can choose it as it is.
        why: the reason; may be empty where it is ready.
    """

    word: Word
    why: str = ""

    def __str__(self) -> str:
        word = self.word if self.word in ("ready", "unsure") else self.word.upper()
        return f"{word}: {self.why}" if self.why else word


def readiness(
    registry: Registry,
    claim: Claim,
    gpu: Callable[[], bool] | None = None,
    missing_sets: Callable[[Registry, Claim], Sequence[str] | None] | None = None,
) -> Readiness:
    """Check that a backend's module and the packages, GPU and weights of its record are available.

    Args:
        registry: of the claim.
        claim: the backend.
        gpu: whether there is a GPU; None for :func:`gpu_is_seen`.
        missing_sets: finds missing weights, as :func:`physic_core.weights.required.missing_sets`. None skips them.
    """
    if claim.problem:
        return Readiness("refused", claim.problem)
    rivals = registry.rivals(claim)
    if twins := [rival for rival in rivals if rival.origin.distribution == claim.origin.distribution]:
        return Readiness("ambiguous", registry.explain_rivals((claim, *twins)))
    found = _readiness(registry, claim, gpu, missing_sets)
    if not rivals:
        return found
    others = " and ".join(dict.fromkeys(rival.origin.distribution for rival in rivals))
    name = f"{claim.origin.distribution}:{claim.record.name}"
    return replace(found, why="; ".join(filter(None, (found.why, f"{others} offers this name too: write '{name}'"))))


def _readiness(
    registry: Registry,
    claim: Claim,
    gpu: Callable[[], bool] | None,
    missing_sets: Callable[[Registry, Claim], Sequence[str] | None] | None,
) -> Readiness:
    """The readiness of a backend that a config can choose."""
    record = claim.record
    if isinstance(record.target, str):
        module = split(record.target)[1].partition(":")[0]
        if not _is_there(module):
            return Readiness("broken", f"there is no module '{module}' for its target {record.target}")
    faults = []
    if absent := [package for package in record.packages if not _is_there(package)]:
        faults.append(f"not installed: {', '.join(absent)}")
    further = [need for need in record.needs if need.lower() not in _GPU]
    if len(further) < len(record.needs) and not (gpu or gpu_is_seen)():
        faults.append("no GPU is seen")
    sets = missing_sets(registry, claim) if missing_sets is not None else None
    if sets:
        faults.append(f"missing: {', '.join(sets)}")
    if faults:
        return Readiness("not ready", "; ".join(faults))
    if sets is not None:
        further = [need for need in further if need != _WEIGHTS]
    if further:
        return Readiness("unsure", f"needs {', '.join(further)}; `physic plugins doctor {record.name}` tells")
    return Readiness("ready")


def missing_requirements(backend: Backend) -> tuple[str, ...]:
    """Call ``missing()`` of a backend: its missing requirements on this machine, one text each.

    Raises:
        BackendError: ``missing()`` fails, or does not return texts.
        PhysicError: raised by the backend itself.
    """
    try:
        answer: object = backend.missing()
    except WeightsMissingError as error:
        return (str(error),)
    except PhysicError:
        raise
    except (Exception, SystemExit) as error:
        raise BackendError(f"missing() fails: {describe(error, type(backend))}") from error
    if not isinstance(answer, (tuple, list)) or not all(isinstance(text, str) for text in answer):
        raise BackendError(f"missing() must return a tuple of texts, got {answer!r}")
    return tuple(answer)


def gpu_is_seen() -> bool:
    """Whether an NVIDIA driver is loaded; faster than importing torch, which takes seconds."""
    return shutil.which("nvidia-smi") is not None or any(Path(trace).exists() for trace in _TRACES)


def _is_there(module: str) -> bool:
    """Whether a module can be found; submodules are searched only if the package is already imported."""
    top = module.partition(".")[0]
    try:
        return find_spec(module if top in sys.modules else top) is not None
    except (ImportError, ValueError, AttributeError):  # a parent package is broken, or has no spec
        return top in sys.modules
