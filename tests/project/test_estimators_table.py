"""The table of adapters of published estimators: one row for each registered backend."""

from __future__ import annotations

from pathlib import Path

from physic_core import list_backends
from physic_core.discovery.backends import load_class
from physic_core.weights.library import licence_text, named_sets

TABLE = Path(__file__).parents[2] / "docs" / "estimators.md"
DISTRIBUTIONS = ("physic-onnx", "physic-transformers", "physic-human", "physic-omnieraser")
ADAPTERS = [offer for offer in list_backends() if offer.distribution in DISTRIBUTIONS]


def test_every_backend_has_one_row():
    rows = [
        line.split("|")[1:3]
        for line in TABLE.read_text("utf-8").splitlines()
        if line.startswith("| ")
    ]
    listed = [(interface.strip(), name.strip(" `")) for interface, name in rows[1:]]
    assert sorted(listed) == sorted((one.interface, one.name) for one in ADAPTERS)


def test_every_adapter_reads_weights_by_default_and_their_licence_is_listed():
    for one in ADAPTERS:
        options = {
            name: field.get_default()
            for name, field in load_class(one).Options.model_fields.items()
        }
        assert licence_text(named_sets(one.distribution, options)), one
