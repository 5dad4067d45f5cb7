"""The weight sets of all installed plugins."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.discovery.claims import normal_name
from physic_core.errors import ConfigError, PhysicError
from physic_core.weights.close_names import in_words, near
from physic_core.weights.manifest import WeightSet, read_manifest

if TYPE_CHECKING:
    from physic_core.discovery.registry import Manifest, Origin

__all__ = ["Library", "Listed", "read_library"]


@dataclass(frozen=True)
class Listed:
    """A weight set and the plugin that lists it.

    Attributes:
        origin: the plugin.
        weights: the set.
    """

    origin: Origin
    weights: WeightSet


@dataclass(frozen=True)
class Library:
    """All listed weight sets.

    Attributes:
        sets: sorted by name, then by distribution.
        broken: plugins with invalid manifests, and the cause.
    """

    sets: tuple[Listed, ...]
    broken: tuple[tuple[Origin, str], ...]

    def get(self, name: str) -> Listed:
        """Return the set with a name; use "distribution:name" if two plugins list the same name.

        Raises:
            ConfigError: no set has this name, or more than one.
        """
        distribution, _, bare = name.rpartition(":")
        asked = normal_name(distribution)
        found = [
            one for one in self.sets if one.weights.name == bare and asked in ("", normal_name(one.origin.distribution))
        ]
        if len(found) == 1:
            return found[0]
        if found:
            choices = " or ".join(f"'{one.origin.distribution}:{bare}'" for one in found)
            raise ConfigError(f"several plugins list weights named '{bare}': write {choices}")
        names = sorted({one.weights.name for one in self.sets})
        close = near(bare, names)
        hint = f"did you mean {in_words(close)}?" if close else "`physic weights list` names all"
        broken = "".join(f"\n{origin}: {why}" for origin, why in self.broken)
        raise ConfigError(f"no weights are named '{name}'; {hint}{broken}")


def read_library(manifests: Iterable[Manifest]) -> Library:
    """Read the manifests of plugins; an invalid one does not affect the others."""
    sets: list[Listed] = []
    broken: list[tuple[Origin, str]] = []
    for manifest in manifests:
        try:
            sets += [Listed(manifest.origin, weights) for weights in read_manifest(manifest.path).values()]
        except PhysicError as error:
            broken.append((manifest.origin, str(error)))
    return Library(tuple(sorted(sets, key=lambda s: (s.weights.name, s.origin.distribution))), tuple(broken))
