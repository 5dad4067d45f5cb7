"""Checks that the weights which a backend reads by default, and the packages that it imports, are
stated.
"""

from __future__ import annotations

import ast
import sys
from importlib.metadata import packages_distributions  # noqa: TID251 -- which distribution a module comes with
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.discovery.entry_points import canonicalize_name, required_versions
from physic_core.interfaces import Packages
from physic_core.weights.library import named_sets
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.discovery.entry_points import Offer
    from physic_testing.conformance.backend_under_test import BackendUnderTest


def check_default_weights_are_listed(subject: BackendUnderTest) -> None:
    """The default of the option `weights` is a set that a manifest of the plugin lists, with its
    licence.
    """
    claim = _claim(subject)
    field = subject.kind.Options.model_fields.get("weights")
    default = None if field is None else field.get_default()
    if not isinstance(default, str) or not default:
        raise CheckSkipped("its options name no weights by default")
    expect(
        bool(named_sets(claim.distribution, {"weights": default})),
        f"a weight set '{default}' in a manifest of {claim.distribution}",
        "none of this name",
        'Name the package of the manifests in the group [project.entry-points."physic.weights"].',
    )


def check_packages_are_required(subject: BackendUnderTest) -> None:
    """The packages that the backend imports are requirements of its distribution, or named by
    `requirements()`.
    """
    claim = _claim(subject)
    subject.result()
    stated = {
        module
        for one in subject.construct().requirements()
        if isinstance(one, Packages)
        for module in one.modules
    }
    needed = _imported(subject.kind) - {subject.kind.__module__.partition(".")[0], *stated}
    names = {canonicalize_name(claim.distribution), *required_versions(claim.distribution)}
    names |= {"physic-core", *required_versions("physic-core")}
    unlisted = sorted(module for module in needed if canonicalize_name(module) not in names)
    provided = packages_distributions() if unlisted else {}  # it reads every installed distribution
    unlisted = [
        m for m in unlisted if names.isdisjoint(map(canonicalize_name, provided.get(m, ())))
    ]
    expect(
        not unlisted,
        "the packages that the backend's module imports, in the requirements of its distribution "
        "or of the backend",
        f"{', '.join(unlisted)} in neither",
        "Add them to `dependencies`, or return `Packages` from `requirements()`.",
    )


def _imported(kind: type) -> set[str]:
    """Return the top-level packages, other than those of Python and PhySIC, that a class's module
    imports anywhere.
    """
    module = sys.modules.get(kind.__module__)
    path = Path(getattr(module, "__file__", None) or "")
    if path.suffix != ".py":
        return set()
    nodes = list(ast.walk(ast.parse(path.read_bytes())))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {
        node.module
        for node in nodes
        if isinstance(node, ast.ImportFrom) and node.module and not node.level
    }
    own = {"physic_core", "physic_testing", *sys.stdlib_module_names}
    return {name.partition(".")[0] for name in names} - own


def _claim(subject: BackendUnderTest) -> Offer:
    """Return the entry point of the backend, or skip the check."""
    if subject.claim is None or not subject.claim.version:
        raise CheckSkipped("not of an installed plugin")
    return subject.claim


CHECKS: tuple[Check, ...] = (
    Check(check_default_weights_are_listed, "physic_core.weights.manifest"),
)
"""Checks that call nothing."""

CHECKS_AFTER_INFER: tuple[Check, ...] = (
    Check(check_packages_are_required, "physic_core.interfaces.Packages", warns=True),
)
"""Checks that need the modules which calls have imported."""
