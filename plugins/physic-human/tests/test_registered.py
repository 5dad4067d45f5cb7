"""The plugin as it is installed: nothing here, everything said, nothing fetched."""

from __future__ import annotations

from pathlib import Path

import pytest

import physic_human
from physic_core import BackendRecord
from physic_core.discovery.plugins import discover
from physic_core.weights import read_manifest
from physic_testing.conformance import check_backend

RECORDS = physic_human.physic_backends()


@pytest.fixture(autouse=True)
def _nothing_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PHYSIC_WEIGHTS", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HF_HOME", str(tmp_path))


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.name)
def test_a_backend_without_its_files_names_them_and_fails_no_check(record: BackendRecord) -> None:
    report = check_backend(record.name, record.interface, registry=discover())
    assert not [r for r in report.results if r.outcome == "failed"], report.text


def test_weights_with_an_account_or_non_commercial_terms_are_marked() -> None:
    sets = read_manifest(physic_human.physic_weights())
    for name in ("camerahmr", "wilor-mini", "deco"):
        assert sets[name].account == (name != "deco"), name  # DECO's own script fetches it without one
        assert sets[name].commercial is False, name
    for one in sets.values():
        assert one.license, one.name
        assert not (one.account and one.is_free), one.name
        assert one.advice or all(file.source for file in one.files), one.name
