"""Explain why no backend has a name, and what to install or to write instead."""

from __future__ import annotations

from collections.abc import Sequence

from physic_core.discovery.catalog import CATALOG, distribution_for, how_to_install, known_names
from physic_core.discovery.close_names import closest_name
from physic_core.discovery.offers import BackendOffer, BrokenPlugin, canonicalize_name, with_article


def explain_missing(
    name: str,
    interface: str | None,
    offers: Sequence[BackendOffer],
    broken: Sequence[BrokenPlugin],
    restriction: str | None,
) -> str:
    """Return a message with the reason why a backend is missing, and the remedy; interface None means any."""
    owner, _, bare = name.rpartition(":")
    of_kind = [c for c in offers if interface in (None, c.record.interface)]
    names = sorted({str(c.record.name) for c in of_kind})
    owners = dict.fromkeys(c.origin.distribution for c in of_kind if c.record.name == bare)
    parts = [f"no {interface or 'backend'} named '{name}'; installed: {', '.join(names) or 'none'}"]
    distributions = list(dict.fromkeys(canonicalize_name(c.origin.distribution) for c in offers))
    is_installed = canonicalize_name(owner) in distributions
    restricted = restriction is not None
    if restricted:
        # First, since a restriction may hide plugins that the later advice would install.
        parts.append(f"PHYSIC_PLUGINS='{restriction}' hides every other plugin: unset it, or add to it")
    if owner and owners and is_installed:
        parts.append(f"'{bare}' comes from {' and '.join(owners)}")
    elif owner and not is_installed:
        if not any(canonicalize_name(one.origin.distribution) == canonicalize_name(owner) for one in broken):
            parts.append(_explain_distribution(canonicalize_name(owner), bare, distributions, restriction))
    elif close := closest_name(bare, names):
        parts.append(f"Did you mean '{close}'?")
    elif close := closest_name(bare, known_names(interface)):
        # No installed name is similar: a distribution that is not installed may offer it.
        known = distribution_for(interface, close) or close
        cure = how_to_install(known)
        if restricted:
            cure = f"add {known} to it, if need be after {cure}"
        asks = "" if close == bare else f"Did you mean '{close}'? "
        parts.append(f"{asks}'{close}' comes with {known}: {cure}")
    elif others := sorted({c.record.interface for c in offers if c.record.name == bare}):
        parts.append(f"'{bare}' is {' and '.join(map(with_article, others))}")
    if broken:
        parts.append(f"Broken plugins: {', '.join(map(str, broken))}")
    return ". ".join(parts).replace("?.", "?")


def _explain_distribution(owner: str, name: str, installed: Sequence[str], restriction: str | None) -> str:
    """Return the reason why the distribution in "distribution:name" offers no such backend, and the remedy."""
    known = dict.fromkeys((*installed, *CATALOG))
    if owner not in known and (close := closest_name(owner, known)):
        return f"Did you mean '{close}:{name}'?"
    if restriction is not None:
        return f"'{name}' comes with {owner}: add {owner} to it, if need be after {how_to_install(owner)}"
    return f"'{name}' comes with {owner}, which is not installed: {how_to_install(owner)}"
