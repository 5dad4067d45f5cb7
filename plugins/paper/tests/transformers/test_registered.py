"""The weights of the plugin as it is installed."""

from __future__ import annotations

from physic_core.weights.library import read_library

NAME = "metricbody-paper"
SETS = {
    one.weights.name: one.weights for one in read_library().sets if one.offer.distribution == NAME
}


def test_every_set_can_be_fetched_and_states_non_commercial_terms():
    for name, group in SETS.items():
        assert name.endswith("-hf"), "names of other plugins' sets have no such end"
        assert all(file.source.startswith("hf://") for file in group.files), name
        free = any(words in group.license for words in ("Apache-2.0", "MIT", "SAM License"))
        assert group.commercial is free, name
        assert group.account is (name == "sam3-hf"), name
