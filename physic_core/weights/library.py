"""The weight sets of all installed plugins, and those that the options of a backend name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from physic_core.discovery.entry_points import (
    WEIGHTS_GROUP,
    Offer,
    canonicalize_name,
    installed_offers,
    weights_folder,
)
from physic_core.discovery.error_text import did_you_mean
from physic_core.errors import ConfigError, PhysicError

if TYPE_CHECKING:
    from physic_core.weights.manifest import WeightSet

NON_COMMERCIAL = re.compile(r"non-?commercial|-NC\b|research only|AMLR", re.IGNORECASE)
"""Words in the name of a licence that forbids commercial use."""


@dataclass(frozen=True)
class ListedWeights:
    """A weight set, and the entry point of the plugin that lists it."""

    offer: Offer
    weights: WeightSet


@dataclass(frozen=True)
class WeightLibrary:
    """The weight sets of all installed plugins.

    Attributes:
        sets: sorted by name, then by distribution.
        broken: plugins with invalid manifests, and the error text.
    """

    sets: tuple[ListedWeights, ...]
    broken: tuple[tuple[Offer, str], ...]

    def get(self, name: str) -> ListedWeights:
        """Return the weight set with a name; "distribution:name" selects the plugin.

        Raises:
            ConfigError: no set has this name, or more than one.
        """
        distribution, _, bare = name.rpartition(":")
        owner = canonicalize_name(distribution)
        matches = [
            one
            for one in self.sets
            if one.weights.name == bare and owner in ("", canonicalize_name(one.offer.distribution))
        ]
        if len(matches) == 1:
            return matches[0]
        if matches:
            choices = " or ".join(f"'{one.offer.distribution}:{bare}'" for one in matches)
            raise ConfigError(f"several plugins list weights named '{bare}': write {choices}")
        hint = (
            did_you_mean(bare, {one.weights.name for one in self.sets})
            or "; `physic weights list` lists all names"
        )
        broken = "".join(f"\n{offer.owner}: {why}" for offer, why in self.broken)
        raise ConfigError(f"no weights are named '{name}'{hint}{broken}")


def read_library() -> WeightLibrary:
    """Read the weight manifests of all plugins; invalid ones are listed in ``broken``."""
    sets: list[ListedWeights] = []
    broken: list[tuple[Offer, str]] = []
    for offer in installed_offers(WEIGHTS_GROUP):
        try:
            sets += [ListedWeights(offer, weights) for weights in _weight_sets_of(offer).values()]
        except PhysicError as error:
            broken.append((offer, str(error)))
    return WeightLibrary(
        tuple(sorted(sets, key=lambda s: (s.weights.name, s.offer.distribution))), tuple(broken)
    )


def named_sets(distribution: str, options: Mapping[str, Any]) -> tuple[WeightSet, ...]:
    """Return the weight sets of a distribution that the options of a backend name, each once.

    Raises:
        PhysicError: a manifest of the distribution is invalid.
    """
    values = [value for value in options.values() if isinstance(value, str)]
    sets_named: dict[str, WeightSet] = {}
    for offer in installed_offers(WEIGHTS_GROUP):
        if offer.distribution == distribution:
            sets = _weight_sets_of(offer)
            sets_named |= {value: sets[value] for value in values if value in sets}
    return tuple(sets_named.values())


def default_sets(backend: Offer) -> tuple[WeightSet, ...]:
    """Return the weight sets that a backend uses by default, as the manifests of its distribution
    state it.

    Raises:
        PhysicError: a manifest of the distribution is invalid.
    """
    name = f"{backend.interface}.{backend.name}"
    lists = [
        offer
        for offer in installed_offers(WEIGHTS_GROUP)
        if offer.distribution == backend.distribution
    ]
    return tuple(
        one for offer in lists for one in _weight_sets_of(offer).values() if name in one.default_of
    )


def licence_text(sets: Iterable[WeightSet]) -> str:
    """Return the licences of weight sets, each once, and where one forbids commercial use; ""
    without sets.
    """
    licences = []
    for one in sets:
        hidden = one.commercial is False and not NON_COMMERCIAL.search(one.license)
        licences.append(f"{one.license}, no commercial use" if hidden else one.license)
    return "; ".join(dict.fromkeys(licences))


def _weight_sets_of(offer: Offer) -> Mapping[str, WeightSet]:
    from physic_core.weights.manifest import read_manifest

    return read_manifest(weights_folder(offer))
