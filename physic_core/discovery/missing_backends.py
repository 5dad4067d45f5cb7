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
    of_kind = [offer for offer in offers if interface in (None, offer.record.interface)]
    names = sorted({str(offer.record.name) for offer in of_kind})
    parts = [f"no {interface or 'backend'} named '{name}'; installed: {', '.join(names) or 'none'}"]
    if restriction is not None:
        # First, since a restriction may hide plugins that the later advice would install.
        parts.append(f"PHYSIC_PLUGINS='{restriction}' hides every other plugin: unset it, or add to it")
    distribution, colon, bare = name.rpartition(":")
    owner = canonicalize_name(distribution)
    owners = dict.fromkeys(offer.origin.distribution for offer in of_kind if offer.record.name == bare)
    origins = (*(offer.origin for offer in offers), *(plugin.origin for plugin in broken))
    installed = {canonicalize_name(origin.distribution) for origin in origins}
    if not colon:
        parts.append(_other_name(bare, interface, offers, names))
    elif owner not in {*installed, *CATALOG} and (close := closest_name(owner, sorted({*installed, *CATALOG}))):
        parts.append(f"Did you mean '{close}:{bare}'?")
    elif owner not in installed:
        parts.append(f"'{bare}' comes with {owner}: {how_to_install(owner)}")
    elif owners:
        parts.append(f"'{bare}' comes from {' and '.join(owners)}")
    if broken:
        parts.append(f"Broken plugins: {', '.join(map(str, broken))}")
    return ". ".join(filter(None, parts)).replace("?.", "?")


def _other_name(name: str, interface: str | None, offers: Sequence[BackendOffer], installed: Sequence[str]) -> str:
    """Return a similar name that is installed or known, or the interfaces that have the name; may be empty."""
    if close := closest_name(name, installed):
        return f"Did you mean '{close}'?"
    if close := closest_name(name, known_names(interface)):
        distribution = distribution_for(interface, close) or close
        return f"'{close}' comes with {distribution}: {how_to_install(distribution)}"
    others = sorted({offer.record.interface for offer in offers if offer.record.name == name})
    return f"'{name}' is {' and '.join(map(with_article, others))}" if others else ""
