"""The weights of the plugin as it is installed: licences and accounts are said."""

from __future__ import annotations

from physic_core.weights.library import read_library


def test_weights_with_an_account_or_non_commercial_terms_are_marked():
    sets = {
        one.weights.name: one.weights
        for one in read_library().sets
        if one.offer.distribution == "physic-human"
    }
    for name in ("camerahmr", "wilor-mini", "deco"):
        # DECO's own script fetches it without one
        assert sets[name].account == (name != "deco"), name
        assert sets[name].commercial is False, name
    for one in sets.values():
        assert one.license, one.name
        assert not (one.account and one.is_free), one.name
        assert one.advice or all(file.source for file in one.files), one.name
