"""Find the missing weight sets of backends, and weight files of unexpected size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import PhysicError
from physic_core.weights.locate import missing, size_mismatches
from physic_core.weights.manifest import read_manifest

if TYPE_CHECKING:
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.discovery.registry import BackendOffer, Registry

__all__ = ["missing_sets", "size_warnings"]


def missing_sets(registry: Registry, offer: BackendOffer) -> tuple[str, ...] | None:
    """Return the names of a backend's missing weight sets, or None if the required sets are unknown."""
    lists = [manifest.path for manifest in registry.manifests if manifest.origin == offer.origin]
    found = []
    try:
        for name in offer.record.weights:
            path = next((path for path in lists if name in read_manifest(path)), None)
            if path is None:
                return None
            if missing(path, name):
                found.append(name)
    except PhysicError:  # an invalid manifest, which `physic weights list` reports
        return None
    return tuple(found) if offer.record.weights else None


def size_warnings(plan: ResolvedPipeline, registry: Registry) -> tuple[str, ...]:
    """Return warnings about weight files whose size differs from the published size; no file is read.

    Raises:
        BackendError: the manifest of a plugin is invalid.
    """
    found: dict[str, None] = {}
    for resolved in plan.backends.values():
        who = resolved.provenance
        for manifest in registry.manifests:
            if (manifest.origin.plugin, manifest.origin.distribution) != (who.plugin, who.distribution):
                continue
            sets = read_manifest(manifest.path)
            named = (sets.get(value) for value in who.options.values() if isinstance(value, str))
            for weights in named:
                if weights is not None and (text := size_mismatches(weights)):
                    found[f"weights '{weights.name}' are found, but {text}"] = None
    return tuple(found)
