"""The weight sets that backends require: which are missing, and which have unexpected sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import PhysicError
from physic_core.weights.locate import missing, other_sizes
from physic_core.weights.manifest import read_manifest

if TYPE_CHECKING:
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.discovery.registry import Claim, Registry

__all__ = ["missing_sets", "remarks"]


def missing_sets(registry: Registry, claim: Claim) -> tuple[str, ...] | None:
    """Names of the missing sets of a backend's record; None if this cannot be determined."""
    lists = [manifest.path for manifest in registry.manifests if manifest.origin == claim.origin]
    found = []
    try:
        for name in claim.record.weights:
            path = next((path for path in lists if name in read_manifest(path)), None)
            if path is None:
                return None
            if missing(path, name):
                found.append(name)
    except PhysicError:  # an invalid manifest, which `physic weights list` reports
        return None
    return tuple(found) if claim.record.weights else None


def remarks(plan: ResolvedPipeline, registry: Registry) -> tuple[str, ...]:
    """Warnings about files whose size differs from the published one; they do not stop a run.

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
                if weights is not None and (told := other_sizes(weights)):
                    found[f"weights '{weights.name}' are here, but {told}"] = None
    return tuple(found)
