"""Which modules come with the requirements of an installed distribution."""

from __future__ import annotations

import re
from collections.abc import Collection
from contextlib import suppress
from importlib import metadata

from physic_core.discovery.offers import canonicalize_name

_NAME = re.compile(r"[A-Za-z0-9._-]+")


def modules_of_requirements(distribution: str, modules: Collection[str]) -> set[str]:
    """Return those of the top-level modules that come with a distribution, its requirements, or those of the core.

    Requirements of extras do not count, and neither do requirements of requirements.
    """
    known = {canonicalize_name(name) for name in ("physic-core", distribution)}
    for name in tuple(known):
        with suppress(metadata.PackageNotFoundError):
            lines = [line for line in metadata.requires(name) or () if "extra ==" not in line]
            known |= {canonicalize_name(found[0]) for line in lines if (found := _NAME.match(line))}
    listed = {module for module in modules if canonicalize_name(module) in known}
    if listed == set(modules):
        return listed
    provided = metadata.packages_distributions()  # reads the files of all distributions
    return {m for m in modules if known & {canonicalize_name(name) for name in provided.get(m, ())}} | listed
