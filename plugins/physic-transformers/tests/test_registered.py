"""The plugin as it is installed, without any weights."""

from __future__ import annotations

from pathlib import Path

import pytest

import physic_transformers
from physic_core import BackendRecord
from physic_core.discovery.plugins import discover
from physic_core.weights import read_manifest
from physic_testing import check_backend

RECORDS = physic_transformers.physic_backends()
SETS = read_manifest(physic_transformers.physic_weights())


@pytest.fixture(autouse=True)
def _nothing_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from huggingface_hub import constants

    monkeypatch.setenv("PHYSIC_WEIGHTS", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_a_backend_without_weights_names_them_and_fails_no_check(record: BackendRecord) -> None:
    registry = discover()
    lacking = registry.load_class(registry.get(record.interface, record.name))().missing()
    assert lacking
    assert all("`physic weights fetch " in line for line in lacking)
    report = check_backend(record.name, record.interface, registry=registry)
    assert not [result for result in report.results if result.outcome == "failed"], report.text


def test_every_set_can_be_fetched_and_states_non_commercial_terms() -> None:
    for name, group in SETS.items():
        assert name.endswith("-hf"), "names of other plugins' sets have no such end"
        assert all(file.source.startswith("hf://") for file in group.files), name
        free = any(words in group.license for words in ("Apache-2.0", "MIT", "SAM License"))
        assert group.commercial is (None if "Sapiens2" in group.license else free), name
        assert group.account is (name == "sam3-hf"), name
