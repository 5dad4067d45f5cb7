"""A person for whom something fails is kept with what is known of them, and does not spoil the
others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from physic_core.pipeline.backend_results import is_real_person
from physic_core.types import MARKS, Keypoints, People, PeoplePrompt, Reconstruction
from physic_core.types.arrays import select_people
from physic_core.types.records import in_words
from physic_mock import backends
from physic_testing.worlds import load_world
from tests.pipeline.mocks import changed, run

pytestmark = pytest.mark.usefixtures("few_steps")

LOST = 0
KEPT = 1


@pytest.fixture(scope="module")
def world():
    return load_world("hug", (160, 120))


@pytest.fixture(scope="module")
def sound(world):
    return run(world.image)


@pytest.fixture(scope="module")
def alone(world):
    """The person who is kept, in a run that finds no one else."""
    one = changed(
        backends.MockSegmenter, lambda found, _: select_people(found, np.arange(2) == KEPT)
    )
    (person,) = run(world.image, backends=one).people
    return person


def spoilt(values):
    values = values.copy()
    values[LOST] = np.nan
    return values


def lose_body(answer, *_):
    lost = spoilt(answer.parameters.body_pose)
    return replace(answer, parameters=replace(answer.parameters, body_pose=lost))


def lose(*names):
    """A change that sets these fields of the lost person to NaN."""
    return lambda answer, *_: replace(
        answer, **{name: spoilt(getattr(answer, name)) for name in names}
    )


def lose_hands(answer, *_):
    found = replace(answer, confidence=np.full_like(answer.confidence, 0.9))
    return lose("rotvecs")(found)


def apart(a, b):
    """Mean distance of the vertices, as a share of the person's distance to the camera."""
    return float(
        np.linalg.norm(a.vertices - b.vertices, axis=-1).mean() / np.linalg.norm(b.joints[0])
    )


def check_unspoilt(kept, sound, alone, world):
    """As near to the truth as with both people or with this one alone."""
    errors = [error_m(person, world) for person in (kept, sound.people[KEPT], alone)]
    assert errors[0] < 1.1 * max(errors[1:])


def error_m(person, world):
    return min(
        float(np.linalg.norm(person.vertices - truth, axis=-1).mean()) for truth in world.vertices
    )


def test_a_person_without_a_body_stays_and_the_other_is_unchanged(
    world, sound, alone, tmp_path, physic
):
    result = run(world.image, backends=changed(backends.MockBodyEstimator, lose_body))
    lost = result.people[LOST]
    kept = result.people[KEPT]
    np.testing.assert_array_equal(lost.mask, sound.people[LOST].mask)
    assert np.isnan(lost.vertices).all()
    assert not lost.contact.any()
    assert np.isposinf(lost.distance).all()
    assert "placed" in lost.failed_checks
    assert "this person has no valid values" in "\n".join(result.warnings)
    assert lost.trust == 0
    assert kept.failed_checks == sound.people[KEPT].failed_checks
    assert "lean" in set(lost.unknown_checks) - set(kept.unknown_checks)
    check_unspoilt(kept, sound, alone, world)
    assert np.isfinite(result.scene.points[result.scene.valid]).all()
    result.save(str(tmp_path / "out"))
    again = Reconstruction.load(str(tmp_path / "out"))
    assert again.checks == result.checks
    assert again.people[LOST].failed_checks == lost.failed_checks
    meshes = set(trimesh.load(tmp_path / "out" / "combined.glb").geometry)
    assert meshes - {"backdrop"} == {"floor", "person_1", "scene"}
    shown = physic("show", tmp_path / "out").stdout.splitlines()[1:3]
    assert shown == [f"person 0: no body, {in_words(MARKS)} doubtful", f"  why: {lost.why}"]


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (backends.MockHandEstimator, lose_hands),
        (backends.MockContactPrior, lose("probability")),
        (backends.MockKeypointDetector, lose("points", "confidence")),
    ],
)
def test_other_invalid_results_of_a_person_are_named_and_the_body_is_kept(
    world, sound, alone, kind, change
):
    result = run(world.image, backends=changed(kind, change))
    failed = [c for c in result.checks if c.name == "placed" and c.failed]
    assert [(c.person, c.value) for c in failed] == [(LOST, 0)]
    assert f"person 0: this person has no valid values from {kind.interface}" in "\n".join(
        result.warnings
    )
    assert all(np.isfinite(person.vertices).all() for person in result.people)
    # The two share the scale of their scene: what one of them no longer says of it moves the other.
    moved = [apart(result.people[KEPT], other) for other in (sound.people[KEPT], alone)]
    assert min(moved) < 0.03
    assert result.people[KEPT].failed_checks == sound.people[KEPT].failed_checks


def two(masks, points, scores=(1.0, 1.0)):
    """Two people with keypoints of the segmenter."""
    keypoints = Keypoints(points.astype(np.float32), np.ones((2, 17), np.float32), "coco17")
    return People(masks, np.zeros((2, 4)), np.array(scores), keypoints=keypoints)


@pytest.mark.parametrize(("on_own", "real"), [(4, False), (7, True)])
def test_a_person_whose_joints_lie_on_another_one_is_not_real(on_own, real):
    """Of 17 joints 7 on the own mask are a person behind another one; a mask that the user gives is
    followed.
    """
    masks = np.zeros((2, 40, 60), bool)
    masks[0, :, :30] = masks[1, :, 30:] = True
    points = np.full((2, 17, 2), 5.0)
    points[1] = 25
    points[1, :on_own] = 45, 20
    people = two(masks, points)
    assert is_real_person(people).tolist() == [True, real]
    assert is_real_person(people, PeoplePrompt(masks=masks)).all()


@pytest.mark.parametrize(("columns", "real"), [(2, False), (12, True)])
def test_a_person_with_a_mask_much_smaller_than_the_joints_is_not_real(columns, real):
    """Of the joints of the second person half lie on the mask of the first."""
    masks = np.zeros((2, 40, 60), bool)
    masks[1, 10:30, 20 : 20 + columns] = True
    masks[0, :, :50] = ~masks[1, :, :50]
    points = np.full((2, 17, 2), 5.0)
    points[1] = np.stack([np.resize([20, 26, 27, 55], 17), np.linspace(10, 28, 17)], -1)
    assert is_real_person(two(masks, points)).tolist() == [True, real]


@pytest.mark.parametrize(("apart", "real"), [(4, False), (16, True)])
def test_of_two_people_with_one_pose_the_lower_score_is_not_real(apart, real):
    masks = np.zeros((2, 40, 60), bool)
    masks[0, :20] = masks[1, 20:] = True
    one = np.stack([np.resize([5, 20], 17), np.linspace(5, 35, 17)], -1)
    points = np.stack([one, one + np.array([apart, 0])])
    for scores in ([0.5, 0.9], [0.9, 0.5]):
        people = two(masks, points, scores)
        lower = int(np.argmin(scores))
        assert is_real_person(people).tolist() == [real or i != lower for i in range(2)]
