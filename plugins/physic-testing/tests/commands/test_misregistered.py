"""Distributions that look like plugins, and that ``physic plugins doctor`` reports."""

from __future__ import annotations

from importlib.metadata import distributions
from typing import Any

import pytest

from physic_testing.commands.misregistered import find_misregistered


def installed_as(site: Any, distribution: str, group: str, requires: str = "") -> None:
    module = site.install(distribution, "")
    folder = site.folder / f"{module}-1.0.dist-info"
    (folder / "entry_points.txt").write_text(f"[{group}]\nx = {module}\n" if group else "")
    if requires:
        with (folder / "METADATA").open("a") as metadata:
            metadata.write(f"Requires-Dist: {requires}\n")


@pytest.mark.parametrize(
    ("distribution", "group", "requires"),
    [
        ("heuristics", "physic_plugins", ""),
        ("heuristics", "physic.plugin", ""),
        ("heuristics", "Physic.Plugins", ""),
        ("physic-mine", "physic", ""),
        ("physic-mine", "physics.plugins", ""),
        ("heuristics", "physics.plugins", "physic-core>=0.1"),
        ("heuristics", "phyisc.plugins", "physic_core"),
    ],
)
def test_an_entry_point_in_a_group_that_is_called_nearly_so_is_noticed(site, distribution, group, requires):
    installed_as(site, distribution, group, requires)
    (row,) = find_misregistered(distributions(path=[str(site.folder)]))
    assert str(row.origin) == f"{distribution} 1.0"
    assert f"'{group}'" in row.cause
    assert find_misregistered(distributions(path=[str(site.folder)]), restriction="physic-other") == ()


def test_a_distribution_that_is_called_like_a_plugin_and_offers_nothing_is_noticed(site):
    installed_as(site, "physic-mine", "console_scripts")
    (row,) = find_misregistered(distributions(path=[str(site.folder)]))
    assert "no entry point in the group 'physic.plugins'" in row.cause


@pytest.mark.parametrize(
    ("distribution", "group", "requires"),
    [
        ("physic-mine", "physic.plugins", "physic-core"),
        ("physics-engine", "physics.plugins", "numpy"),
        ("physic", "console_scripts", ""),
        ("studio", "console_scripts", "physic-core"),
        ("studio", "physics.plugins", "physic-core-extras"),
    ],
)
def test_a_distribution_that_is_no_lost_plugin_is_left_alone(site, distribution, group, requires):
    installed_as(site, distribution, group, requires)
    assert find_misregistered(distributions(path=[str(site.folder)])) == ()
