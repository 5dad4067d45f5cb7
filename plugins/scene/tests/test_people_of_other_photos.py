"""People whom the reference photo does not show are in the result, with an empty mask there."""

from __future__ import annotations

import json

import numpy as np
import pytest

from physic_core import load_config, load_reconstruction
from physic_core.interfaces import INTERFACES
from physic_scene import ScenePipeline, save_scene
from physic_testing.worlds import load_world

pytestmark = pytest.mark.slow

QUIET = {name: {"options": {"noise": 0.25}} for name in INTERFACES}
MISSED = {
    **QUIET,
    "segmenter": {"options": {"noise": 0.25, "noise_seed": 101, "missed_people": 0.9}},
}
"""The segmenter misses some of the four people of the world in each photo."""
NAMES = ["a.png", "b.png", "c.png"]


@pytest.fixture(scope="module")
def found():
    config = load_config(
        preset="mock", flags={"noise": MISSED}, overrides=["engine.joint.optimiser.steps=10"]
    )
    worlds = [load_world(f"group_view{i}", (240, 180)) for i in (1, 2, 3)]
    with ScenePipeline(config) as scene:
        return scene.join_photos([scene.reconstruct_photo(world.image) for world in worlds], NAMES)


@pytest.fixture(scope="module")
def others(found):
    """Return the indices of the photos but the reference, both of which show the fourth person."""
    return tuple(i for i in range(3) if i != found.reference)


def test_a_person_of_other_photos_is_in_the_result(found, others):
    people = found.reconstruction.people
    assert len(people) == 4
    other = people[3]
    assert not other.mask.any()
    assert not other.box.any()
    assert np.isfinite(other.vertices).all()
    assert other.contact.any()
    assert other.trust is not None
    assert tuple(photo.index for photo in found.photos if 3 in photo.shown) == others
    own = NAMES[found.reference]
    views = ", ".join(NAMES[i] for i in others)
    (note,) = [note for note in found.reconstruction.notes if note.startswith("person 3 is in")]
    assert views in note
    assert own in note


def test_what_the_reference_does_not_show_is_not_measured(found):
    own = {check.name: check for check in found.reconstruction.checks if check.person == 3}
    assert not own["placed"].failed
    for name in ("heads", "body_in_mask", "low_depth", "limb_keypoints"):
        assert own[name].value is None


def test_the_person_is_saved_and_read(found, tmp_path):
    save_scene(found, str(tmp_path / "out"))
    assert not load_reconstruction(tmp_path / "out").people[3].mask.any()
    document = json.loads((tmp_path / "out" / "cameras.json").read_text())
    assert sum(3 in photo["people"] for photo in document["photos"]) == 2
