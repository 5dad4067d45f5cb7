"""The plugin as it is installed: nothing here, everything said, nothing fetched."""

from __future__ import annotations

import pytest

from physic_core import list_backends
from physic_core.weights.library import read_library
from physic_testing.conformance import check_backend

OFFERS = [offer for offer in list_backends() if offer.distribution == "metricbody-paper"]


@pytest.fixture(autouse=True)
def _nothing_here(monkeypatch, tmp_path):
    monkeypatch.setenv("PHYSIC_WEIGHTS", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HF_HOME", str(tmp_path))


@pytest.mark.parametrize("offer", OFFERS, ids=lambda offer: offer.name)
def test_a_backend_without_its_files_names_them_and_fails_no_check(offer):
    report = check_backend(offer.name, offer.interface)
    assert not [r for r in report.results if r.outcome == "failed"], report.text


def test_weights_with_an_account_or_non_commercial_terms_are_marked():
    sets = {
        one.weights.name: one.weights
        for one in read_library().sets
        if one.offer.distribution == "metricbody-paper"
    }
    for name in ("camerahmr", "wilor-mini", "deco"):
        # DECO's own script fetches it without one
        assert sets[name].account == (name != "deco"), name
        assert sets[name].commercial is False, name
    for one in sets.values():
        assert one.license, one.name
        assert not (one.account and one.is_free), one.name
        assert one.advice or all(file.source for file in one.files), one.name
