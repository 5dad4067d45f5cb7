"""A name that two distributions offer for one of its interfaces."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from physic_core.cli import main
from physic_core.discovery.registry import BackendOffer, BackendRecord, Origin, Registry


def test_check_refuses_a_name_of_two_distributions_before_it_tries_any(monkeypatch: pytest.MonkeyPatch):
    other = BackendOffer(
        BackendRecord("metric_depth", "embedded", "m:C", api=1), Origin("other", "physic-other", "1.0")
    )
    registry = Registry([other])
    interfaces = list(dict.fromkeys(claim.record.interface for claim in registry.find_by_name("embedded")))
    assert interfaces.index("metric_depth") > 0  # else nothing would be tried before it anyway
    rivals = [claim for claim in registry.find_by_name("embedded") if claim.record.interface == "metric_depth"]
    monkeypatch.setattr("physic_core.discovery.plugins.discover", lambda: registry)
    tried: list[str] = []
    monkeypatch.setattr("physic_testing.conformance.check_backend", lambda *args, **_: tried.append(args[1]))
    done = CliRunner().invoke(main, ["plugins", "check", "embedded"])
    assert done.stderr == f"Error: {registry.explain_ambiguity(rivals)}\n"
    assert (done.exit_code, done.stdout, tried) == (2, "", [])
