"""The weight sets of all installed plugins, and those that a backend lacks."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.discovery.close_names import format_choice, similar_names
from physic_core.discovery.offers import canonicalize_name
from physic_core.errors import ConfigError, PhysicError
from physic_core.weights.find import missing
from physic_core.weights.manifest import WeightSet, read_manifest

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.discovery.registry import BackendOffer, Manifest, Origin, Registry

NON_COMMERCIAL = re.compile(r"non-?commercial|-NC\b|research only|AMLR", re.IGNORECASE)
"""Words by which the name of a licence tells that it forbids commercial use."""


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


def named_sets(registry: Registry, offer: BackendOffer) -> dict[str, tuple[Path, WeightSet] | None]:
    """Return the manifest and the set of each name in a backend's record; None for names that its plugin does not list.

    Raises:
        BackendError: a manifest of the plugin is invalid.
    """
    lists = [manifest.path for manifest in registry.manifests if manifest.origin == offer.origin]
    found: dict[str, tuple[Path, WeightSet] | None] = dict.fromkeys(offer.record.weights)
    for path in lists:
        sets = read_manifest(path)
        found |= {name: (path, sets[name]) for name in found if found[name] is None and name in sets}
    return found


def missing_sets(registry: Registry, offer: BackendOffer) -> tuple[str, ...] | None:
    """Return the names of a backend's missing weight sets, or None if the required sets are unknown."""
    try:
        sets = named_sets(registry, offer)
        absent = [name for name, one in sets.items() if one is not None and missing(one[0], name)]
    except PhysicError:  # an invalid manifest, which `physic weights list` reports
        return None
    return tuple(absent) if sets and None not in sets.values() else None


def weights_licence(registry: Registry, offer: BackendOffer) -> str:
    """Return the licence of a backend's default weights: that of the manifest, or of the record without a manifest."""
    try:
        sets = [one[1] for one in named_sets(registry, offer).values() if one is not None]
    except PhysicError:
        sets = []
    licences = [f"{one.license}, no commercial use" if _hides_its_terms(one) else one.license for one in sets]
    return "; ".join(dict.fromkeys(licences)) or offer.record.weights_license


def _hides_its_terms(weights: WeightSet) -> bool:
    """Return whether a licence forbids commercial use, and its name does not tell."""
    return weights.commercial is False and not NON_COMMERCIAL.search(weights.license)
