"""Which point of another mesh each vertex is: against the truth, with no sides exchanged; and how
maps are kept.
"""

from __future__ import annotations

import re
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from physic_convert import correspondence_cache as module
from physic_convert.correspondence import find_correspondence
from physic_convert.correspondence_cache import cached_correspondence
from physic_core.body import rest_mesh_of_model
from physic_core.conversion import convert_contact
from physic_core.errors import BodyModelError
from physic_core.types import ContactProbability


@pytest.fixture(scope="module")
def onto_other(embedded, other_model):
    """Where the vertices of the embedded body lie on the other one."""
    return find_correspondence(rest_mesh_of_model(other_model), embedded)


@pytest.fixture(scope="module")
def onto_embedded(embedded, other_model):
    """Where the vertices of the other body lie on the embedded one."""
    return find_correspondence(rest_mesh_of_model(embedded), other_model)


def test_vertices_find_their_places_on_the_other_body(onto_embedded, embedded, other, other_model):
    """Of the other body it is known which vertices of the embedded one each of its vertices is the
    mean of.
    """
    rest = rest_mesh_of_model(embedded).vertices.astype(float)
    outer = other_model.outer.numpy()
    off = onto_embedded.interpolate(rest) - other.from_embedded @ rest
    apart = np.linalg.norm(off[outer], axis=1)
    assert apart.mean() < 0.6e-3
    assert np.percentile(apart, 95) < 2e-3
    assert apart.max() < 20e-3
    assert onto_embedded.is_sure[outer].mean() > 0.98


@pytest.fixture(scope="module")
def carried():
    """Contact of a model's vertices on those of another one."""

    def convert(probability, model, onto):
        given = ContactProbability(probability, model.topology, rest_mesh_of_model(model))
        return convert_contact(given, onto)

    return convert


def test_contact_is_carried_there_and_back(embedded, other_model, carried):
    names = ["left_foot", "right_foot", "left_hand", "right_hand", "thighs", "gluteus", "back"]
    before = np.zeros((len(names), embedded.num_vertices), np.float32)
    for row, name in zip(before, names, strict=True):
        row[embedded.contact_sets[name].numpy()] = 0.9
    there = carried(before, embedded, other_model)
    assert there.topology == "smplx"
    assert there.probability.dtype == np.float32
    assert there.probability.max() <= 0.9 + 1e-6
    back = carried(there.probability, other_model, embedded)
    assert back.topology == embedded.topology
    was = before > 0.5
    found = back.probability > 0.5
    f1 = 2 * (was & found).sum(1) / (was.sum(1) + found.sum(1))
    assert f1.min() > 0.95
    for row, other_side in enumerate((1, 0, 3, 2)):
        assert not back.probability[row, was[other_side]].any(), names[row]


def test_cavities_are_never_in_contact_and_what_is_unknown_stays_so(embedded, other_model, carried):
    some = np.ones((2, other_model.num_vertices), np.float32)
    some[1] = np.nan
    converted = carried(some, other_model, embedded).probability
    outer = embedded.outer.numpy()
    assert (converted[0, outer] > 0.999).all()
    assert not converted[0, ~outer].any()
    assert np.isnan(converted[1, outer]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: 1000 * v, "is 1.71e+03 wide"),
        (lambda v: v[:, [0, 2, 1]], "0.307 high"),
        (lambda v: v * [0.3, 1, 1], "is 0.513 wide"),
    ],
    ids=["millimetres", "z up", "arms down"],
)
def test_a_mesh_that_is_no_t_pose_is_refused(change, words, embedded, other_model):
    rest = rest_mesh_of_model(other_model)
    with pytest.raises(BodyModelError, match=re.escape(words)):
        find_correspondence(replace(rest, vertices=change(rest.vertices)), embedded)


def test_a_map_is_kept_and_found_again(embedded, onto_other, other_model, tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path))
    monkeypatch.setattr(module, "find_correspondence", lambda rest, model: onto_other)
    rest = rest_mesh_of_model(other_model)
    cached_correspondence(rest, embedded)
    (file,) = (tmp_path / "maps").iterdir()
    assert file.name.startswith("smplx-physic-embedded-1-")
    assert file.name.endswith(".map.npz")

    monkeypatch.setattr(module, "find_correspondence", never := Mock(side_effect=LookupError))
    found = cached_correspondence(rest, embedded)
    assert_array_equal(found.corners, onto_other.corners)
    assert_allclose(found.shares, onto_other.shares, atol=1e-6)
    assert_array_equal(found.is_sure, onto_other.is_sure)
    never.assert_not_called()
    with pytest.raises(LookupError):
        cached_correspondence(replace(rest, vertices=rest.vertices + np.float32(1e-4)), embedded)

    file.write_bytes(file.read_bytes()[:1000])
    monkeypatch.setattr(module, "find_correspondence", lambda rest, model: onto_other)
    assert cached_correspondence(rest, embedded) is onto_other
