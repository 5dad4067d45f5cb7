"""Find the missing weight sets of backends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import PhysicError
from physic_core.weights.locate import missing
from physic_core.weights.manifest import read_manifest

if TYPE_CHECKING:
    from physic_core.discovery.registry import BackendOffer, Registry

__all__ = ["missing_sets"]


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
