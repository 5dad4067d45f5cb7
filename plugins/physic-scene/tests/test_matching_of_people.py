"""People who stand in symmetry about a middle are told apart by the background or their clothes, or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core import Pipeline
from physic_core.body import JOINT_INDEX
from physic_core.errors import InputError
from physic_core.types import skeleton_named
from physic_scene.background import BackgroundSettings, BackgroundTurn
from physic_scene.matching import MatchingSettings, match_pair
from physic_scene.observations import COLOUR_GROUPS, PhotoPeople
from physic_scene.rigid import Pose, angle_deg
from physic_scene.selection import Photo, select_photos
from physic_testing.worlds import build_world

MIDDLE = np.array([0.0, 0.0, 4.0])
TURN = Rotation.from_euler("y", 40, degrees=True).as_matrix()
HALF_TURN = Rotation.from_euler("y", 180, degrees=True).as_matrix()


def photo(joints: np.ndarray) -> PhotoPeople:
    """Return people in like clothes with joints (N, 55, 3), and the keypoints that a photo of 120 x 90 px shows."""
    n, skeleton = len(joints), skeleton_named("coco17")
    landmarks = joints[:, [JOINT_INDEX.get(name, JOINT_INDEX["head"]) for name in skeleton.names]]
    K = np.array([[100.0, 0.0, 59.5], [0.0, 100.0, 44.5], [0.0, 0.0, 1.0]])
    pixels = landmarks @ K.T
    return PhotoPeople(
        rows=tuple(range(n)),
        K=K,
        focal_sigma=0.1,
        skeleton=skeleton,
        points=pixels[..., :2] / pixels[..., 2:],
        confidence=np.ones(landmarks.shape[:2]),
        landmarks=landmarks,
        joints=joints,
        rotations=np.zeros((n, 55, 3, 3)),
        betas=np.zeros((n, 10)),
        stature=np.full(n, 1.75),
        colours=np.full((n, len(COLOUR_GROUPS), 3), 40.0),
        size_px=np.full(n, 45.0),
        up=np.full(3, np.nan),
    )


def turned(rotation: np.ndarray, llr: float) -> BackgroundTurn:
    """Return a rotation between two cameras by backgrounds, without its pixels."""
    return BackgroundTurn(rotation, llr, np.zeros((0, 2)), np.zeros((0, 2)))


@pytest.fixture
def facing_each_other():
    """Return two photos of two people who face each other, and the motion between the cameras."""
    rng = np.random.default_rng(5)
    body = rng.normal(0, [0.2, 0.5, 0.2], (55, 3))
    body[0] = 0
    person = body + np.array([0.8, 0, 0])
    joints = np.stack([person, person @ HALF_TURN.T]) + MIDDLE
    motion = Pose(TURN, MIDDLE - TURN @ MIDDLE)
    return photo(joints), photo(motion.to_camera(joints)), motion


@pytest.mark.parametrize("swapped", [False, True])
def test_the_background_tells_people_apart_who_face_each_other(facing_each_other, swapped):
    one, two, motion = facing_each_other
    rotation = motion.rotation @ HALF_TURN if swapped else motion.rotation
    found = match_pair(one, two, MatchingSettings(), turned(rotation, 20.0))
    assert {(i, j) for i, j, _ in found.pairs} == ({(0, 1), (1, 0)} if swapped else {(0, 0), (1, 1)})
    assert angle_deg(found.motion.rotation, rotation) < 1


def test_a_background_that_matches_by_chance_changes_nothing(facing_each_other):
    one, two, _ = facing_each_other
    alone = match_pair(one, two, MatchingSettings())
    chance = turned(Rotation.from_euler("x", 90, degrees=True).as_matrix(), -9.2)
    found = match_pair(one, two, MatchingSettings(), chance)
    assert found.pairs == alone.pairs
    assert found.score == pytest.approx(alone.score)


def in_clothes(people: PhotoPeople, *lightness: float) -> PhotoPeople:
    """Return people in clothes of these colours; NaN where the photo shows none."""
    return replace(people, colours=np.broadcast_to(np.array(lightness)[:, None, None], people.colours.shape))


def test_people_who_look_alike_have_no_margin(facing_each_other):
    one, two, motion = facing_each_other
    limit = MatchingSettings().ambiguous
    assert match_pair(one, two, MatchingSettings()).margin == pytest.approx(0, abs=0.01)
    assert match_pair(one, two, MatchingSettings(), turned(motion.rotation, 20.0)).margin > limit
    assert match_pair(in_clothes(one, 20, 60), in_clothes(two, 20, 60), MatchingSettings()).margin > limit


@pytest.fixture(scope="module")
def choose():
    """Return a function that chooses from photos of given people, whose pictures are ramps without features."""
    with Pipeline("mock") as pipeline:
        result = pipeline(build_world("hug", 4, (120, 90)).image)
    down, right = np.mgrid[0:255:90j, 0:255:120j]
    ramps = right, right[:, ::-1], down

    def chosen(*people: PhotoPeople):
        names = ["a.png", "b.png", "c.png"][: len(people)]
        pictures = [np.repeat(grey[..., None], 3, axis=2).astype(np.uint8) for grey in ramps]
        photos = [
            Photo(i, name, replace(result, image=picture), one)
            for i, (name, picture, one) in enumerate(zip(names, pictures, people, strict=False))
        ]
        return select_photos(photos, names, MatchingSettings(), BackgroundSettings())

    return chosen


def test_two_photos_in_which_people_look_alike_are_refused(facing_each_other, choose):
    one, two, _ = facing_each_other
    with pytest.raises(InputError) as error:
        choose(one, two)
    assert str(error.value) == (
        "who is who in these photos is not clear, as their people look alike (a.png, b.png): add a photo from a "
        "direction between the others, or one in which people wear clothes of different colours"
    )


def test_two_photos_of_people_in_different_clothes_are_joined(facing_each_other, choose):
    one, two, _ = facing_each_other
    found = choose(in_clothes(one, 20, 60), in_clothes(two, 20, 60))
    assert found.rows.tolist() == [[0, 0], [1, 1]]
    assert not found.left_out


def test_a_third_photo_in_which_people_look_alike_is_left_out(facing_each_other, choose):
    one, two, _ = facing_each_other
    third = photo(Pose(TURN.T, MIDDLE - TURN.T @ MIDDLE).to_camera(one.joints))
    found = choose(in_clothes(one, 20, 60), in_clothes(two, 20, 60), in_clothes(third, np.nan, np.nan))
    assert found.rows.tolist() == [[0, 0], [1, 1]]
    assert [(left.photo, left.reason) for left in found.left_out] == [("c.png", "ambiguous")]
    assert found.left_out[0].message == (
        "c.png is skipped: who is who in it is not clear; add a photo from a direction between the others, or one in "
        "which people wear clothes of different colours"
    )
