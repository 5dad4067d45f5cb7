"""The weight sets of all installed plugins, and those that a backend lacks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.discovery.close_names import format_choice, similar_names
from physic_core.discovery.offers import canonicalize_name
from physic_core.errors import ConfigError, PhysicError
from physic_core.weights.locate import missing
from physic_core.weights.manifest import WeightSet, read_manifest

if TYPE_CHECKING:
    from physic_core.discovery.registry import BackendOffer, Manifest, Origin, Registry


@dataclass(frozen=True)
class ListedWeights:
    """A weight set, and the plugin that lists it."""

    origin: Origin
    weights: WeightSet


@dataclass(frozen=True)
class WeightLibrary:
    """The weight sets of all installed plugins.

    Attributes:
        sets: sorted by name, then by distribution.
        broken: plugins with invalid manifests, and the error text.
    """

    sets: tuple[ListedWeights, ...]
    broken: tuple[tuple[Origin, str], ...]

    def get(self, name: str) -> ListedWeights:
        """Return the weight set with a name; "distribution:name" selects the plugin.

        Raises:
            ConfigError: no set has this name, or more than one.
        """
        distribution, _, bare = name.rpartition(":")
        owner = canonicalize_name(distribution)
        found = [
            one
            for one in self.sets
            if one.weights.name == bare and owner in ("", canonicalize_name(one.origin.distribution))
        ]
        if len(found) == 1:
            return found[0]
        if found:
            choices = " or ".join(f"'{one.origin.distribution}:{bare}'" for one in found)
            raise ConfigError(f"several plugins list weights named '{bare}': write {choices}")
        names = sorted({one.weights.name for one in self.sets})
        close = similar_names(bare, names)
        hint = f"did you mean {format_choice(close)}?" if close else "`physic weights list` lists all names"
        broken = "".join(f"\n{origin}: {why}" for origin, why in self.broken)
        raise ConfigError(f"no weights are named '{name}'; {hint}{broken}")


def read_library(manifests: Iterable[Manifest]) -> WeightLibrary:
    """Read the weight manifests of all plugins; invalid ones are listed in ``broken``."""
    sets: list[ListedWeights] = []
    broken: list[tuple[Origin, str]] = []
    for manifest in manifests:
        try:
            sets += [ListedWeights(manifest.origin, weights) for weights in read_manifest(manifest.path).values()]
        except PhysicError as error:
            broken.append((manifest.origin, str(error)))
    return WeightLibrary(tuple(sorted(sets, key=lambda s: (s.weights.name, s.origin.distribution))), tuple(broken))


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
