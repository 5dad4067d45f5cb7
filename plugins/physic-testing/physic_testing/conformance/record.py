"""Checks that a backend's record says of its weights and packages what their manifest and the process say."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.discovery.readiness import is_installed
from physic_core.discovery.requirements import modules_of_requirements
from physic_core.weights.library import NON_COMMERCIAL, named_sets
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.discovery.registry import BackendOffer
    from physic_core.weights.manifest import WeightSet
    from physic_testing.conformance.backend_under_test import BackendUnderTest

_QUOTE = "Quote the licence of the weights, not that of the code."
_LICENCE = re.compile(r"\b(MIT|A?L?GPL(?:-\d[\w.]*)?|Apache-2\.0|BSD-\d-Clause|CC0(?:-1\.0)?|CC-BY(?:-\w+)*-\d\.\d)\b")


def check_record_names_weights_that_exist(subject: BackendUnderTest) -> None:
    """Each weight set of the record is in a manifest of its plugin."""
    claim, sets = _named(subject)
    unknown = [name for name, one in sets.items() if one is None]
    expect(
        not unknown,
        f"weight sets that a manifest of {claim.origin.distribution} lists",
        f"none of this name: {', '.join(unknown)}",
        "Return the folder of the manifest from the hook physic_weights().",
    )


def check_record_states_the_licence_of_the_weights(subject: BackendUnderTest) -> None:
    """The record's licence is that of the manifest, and so is what it says of commercial use."""
    claim, sets = _named(subject)
    stated = claim.record.weights_license
    for name, one in sets.items():
        if one is None:
            continue
        expect(
            bool(stated), f"the licence of the weights '{name}', {one.license!r}", "an empty weights_license", _QUOTE
        )
        expect(
            one.commercial is not False or bool(NON_COMMERCIAL.search(stated)),
            f"a licence without commercial use, as the manifest states for '{name}': {one.license!r}",
            f"{stated!r}",
            _QUOTE,
        )
        ours, theirs = set(_LICENCE.findall(stated)), set(_LICENCE.findall(one.license))
        expect(
            not (ours and theirs) or bool(ours & theirs),
            f"the licence of the manifest for '{name}', {one.license!r}",
            f"{stated!r}",
            _QUOTE,
        )


def check_record_names_packages_that_it_uses(subject: BackendUnderTest) -> None:
    """The record and the distribution list the packages that the backend imports, and no other."""
    claim = _claim(subject)
    subject.result()
    packages = claim.record.packages
    absent = [package for package in packages if not is_installed(package)]
    expect(not absent, "packages that are installed", f"no package {', '.join(absent)}", "`packages` are import names.")
    needed = _imported(subject.kind) - {subject.kind.__module__.partition(".")[0], *packages}
    unlisted = sorted(needed - modules_of_requirements(claim.origin.distribution, needed))
    expect(
        not unlisted,
        "the packages that the backend's module imports, in the record or in the requirements of its distribution",
        f"{', '.join(unlisted)} in neither",
        "Add them to `packages` of the record, or to `dependencies`.",
    )
    unused = [package for package in packages if package not in sys.modules]
    expect(
        not unused,
        "packages that the backend imports",
        f"{', '.join(unused)} is not imported after calls",
        "Remove them from `packages` of the record.",
    )


def _imported(kind: type) -> set[str]:
    """Return the top-level packages, other than those of Python and PhySIC, that a class's module imports anywhere."""
    module = sys.modules.get(kind.__module__)
    path = Path(getattr(module, "__file__", None) or "")
    if path.suffix != ".py":
        return set()
    nodes = list(ast.walk(ast.parse(path.read_bytes())))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module and not node.level}
    own = {"physic_core", "physic_testing", *sys.stdlib_module_names}
    return {name.partition(".")[0] for name in names} - own


def _claim(subject: BackendUnderTest) -> BackendOffer:
    """Return the registration, or skip the check."""
    if subject.claim is None:
        raise CheckSkipped("not registered by a plugin")
    return subject.claim


def _named(subject: BackendUnderTest) -> tuple[BackendOffer, dict[str, WeightSet | None]]:
    """Return the registration and the weight sets that its record names, or skip the check."""
    claim = _claim(subject)
    if not claim.record.weights or subject.registry is None:
        raise CheckSkipped("its record names no weights")
    return claim, {name: found and found[1] for name, found in named_sets(subject.registry, claim).items()}


_RECORD = "physic_core.BackendRecord"
CHECKS: tuple[Check, ...] = (
    Check(check_record_names_weights_that_exist, _RECORD),
    Check(check_record_states_the_licence_of_the_weights, _RECORD),
)
"""Checks of a record, which call nothing."""

CHECKS_AFTER_INFER: tuple[Check, ...] = (Check(check_record_names_packages_that_it_uses, _RECORD, warns=True),)
"""Checks of a record that need the modules which calls have imported."""
