"""The plugin as it is installed, without any weights."""

from __future__ import annotations

import pytest

from physic_core import list_backends
from physic_core.discovery.backends import load_class
from physic_core.weights.library import read_library
from physic_testing import check_backend

NAME = "physic-transformers"
OFFERS = [offer for offer in list_backends() if offer.distribution == NAME]
SETS = {
    one.weights.name: one.weights for one in read_library().sets if one.offer.distribution == NAME
}


@pytest.mark.parametrize("offer", OFFERS, ids=lambda offer: offer.name)
def test_a_backend_without_weights_names_them_and_fails_no_check(offer):
    lacking = load_class(offer)().missing()
    assert lacking
    assert all("`physic weights fetch " in line for line in lacking)
    report = check_backend(offer.name, offer.interface)
    assert not [result for result in report.results if result.outcome == "failed"], report.text


def test_every_set_can_be_fetched_and_states_non_commercial_terms():
    for name, group in SETS.items():
        assert name.endswith("-hf"), "names of other plugins' sets have no such end"
        assert all(file.source.startswith("hf://") for file in group.files), name
        free = any(words in group.license for words in ("Apache-2.0", "MIT", "SAM License"))
        assert group.commercial is free, name
        assert group.account is (name == "sam3-hf"), name
