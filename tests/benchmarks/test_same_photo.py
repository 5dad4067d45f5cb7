"""``benchmarks/same_photo``: known answers come out as these changes, and examples keep their
lens.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.same_photo.changes import change, table
from benchmarks.same_photo.variants import PHOTO, VARIANTS, Variant, answer_of
from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.types import Intrinsics, Person, Reconstruction, Scene

WIDTH = 640
HEIGHT = 480
CAMERA = replace(Intrinsics.from_focal(600.0, WIDTH, HEIGHT), focal_sigma=0.2)
BY_NAME = {variant.name: variant for variant in VARIANTS}


def result(mirrored=False):
    """A person at the left and 4 m away, with a left foot that touches."""
    model = load_body("embedded")
    rotations, betas, transl = model.zero_pose()
    sign = -1 if mirrored else 1
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[100:400, 50:200] = True
    ramp = np.broadcast_to(np.linspace(2, 6, WIDTH), (HEIGHT, WIDTH))
    points = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    points[..., 2] = ramp
    if mirrored:
        mask = mask[:, ::-1]
        points = points[:, ::-1]
    joints = np.tile(np.array([sign * -1.0, 0.2, 4.0], np.float32), (55, 1))
    person = Person(
        box=np.array([50, 100, 200, 400], np.float32),
        score=0.9,
        mask=mask,
        keypoints=np.zeros((17, 2)),
        keypoint_confidence=np.ones(17),
        parameters=parameters_from_rotations(rotations, betas, rotations.new_zeros(1, 0), transl),
        vertices=np.zeros((10, 3), np.float32),
        joints=joints,
        contact=np.zeros(10, bool),
        distance=np.zeros(10),
        world_contact={"left_foot": 0.9, "right_foot": 0.3, "seat": 0.2}
        if not mirrored
        else {"right_foot": 0.9, "left_foot": 0.3, "seat": 0.2},
    )
    nothing = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    image = nothing.astype(np.uint8)
    valid = np.ones((HEIGHT, WIDTH), bool)
    scene = Scene(points, nothing, image, valid, None, np.zeros((0, 3)), scale_sigma=0.1)
    return Reconstruction(
        image, CAMERA, scene, (person,), np.zeros((0, 3), np.int32), "embedded", "coco17"
    )


def answer():
    return answer_of(result(), PHOTO, WIDTH, HEIGHT)


def test_the_mirrored_result_of_a_mirrored_photo_is_no_change():
    found = change(answer(), answer_of(result(mirrored=True), BY_NAME["mirror"], WIDTH, HEIGHT))
    assert (found.visible, found.lost, found.new, len(found.people)) == (1, 0, 0, 1)
    (person,) = found.people
    assert [found.scene, person.distance, person.sigmas] == pytest.approx([0] * 3, abs=1e-6)
    assert all(one == other for one, other in person.parts)


def test_a_result_that_is_not_mirrored_is_another_person():
    found = change(answer(), answer_of(result(), BY_NAME["mirror"], WIDTH, HEIGHT))
    assert (found.lost, found.new) == (1, 1)


def test_what_is_changed_by_hand_is_measured():
    one = answer()
    (person,) = one.people
    parts = {"left_foot": 0.4, "right_foot": 0.3, "seat": 0.05}
    moved = replace(person, distance=1.1 * person.distance, parts=parts, usable=(), trust=0.2)
    other = replace(one, people=(moved,), depth=0.9 * one.depth)
    found = change(replace(one, people=(replace(person, usable=("place",), trust=0.9),)), other)
    assert np.exp(found.scene) == pytest.approx(0.9, rel=1e-6)
    assert np.exp(found.people[0].distance) == pytest.approx(1.1)
    assert found.people[0].sigmas == pytest.approx(math.log(1.1) / math.hypot(0.1, 0.2))
    row = dict(zip(*table({"changed": [found]}), strict=True))
    assert row["distance %"] == "10; 10"
    assert row["unsure parts cross %"] == "33"  # the left foot, of three
    assert (row["usable marks %"], row["trust"]) == ("100", "0.7; 0.7")


@pytest.mark.parametrize("name", ["crop8", "column", "scale"])
def test_the_part_of_a_result_that_a_variant_shows_is_no_change(name):
    variant = BY_NAME[name]
    whole = result()
    left, top, right, bottom = variant.window(WIDTH, HEIGHT)
    inside = slice(top, bottom), slice(left, right)
    scene = replace(whole.scene, points=whole.scene.points[inside], valid=whole.scene.valid[inside])
    people = tuple(replace(person, mask=person.mask[inside]) for person in whole.people)
    camera = variant.camera(CAMERA)
    found = change(
        answer(),
        answer_of(
            replace(whole, intrinsics=camera, scene=scene, people=people), variant, WIDTH, HEIGHT
        ),
    )
    assert (found.visible, found.lost, found.new) == (1, 0, 0)
    assert found.scene == pytest.approx(0, abs=2e-3)  # depths are read at the nearest pixels


def test_a_person_whom_a_crop_cuts_off_is_not_missed():
    variant = Variant("left half gone", margin=0.4)
    found = change(answer(), replace(answer_of(result(), variant, WIDTH, HEIGHT), people=()))
    assert (found.visible, found.lost, found.new) == (0, 0, 0)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_a_pixel_lies_on_the_same_ray_in_photo_and_variant(variant):
    camera = Intrinsics(600.0, 600.0, 330.0, 230.0, WIDTH, HEIGHT)
    photo = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    photo[200:260, 400:500] = 255
    own = variant.camera(camera)
    picture = variant.picture(photo)
    assert picture.shape[:2] == (own.height, own.width)

    def ray(image, of):
        rows, columns = np.nonzero(image[..., 0] > 127)
        x = (columns.mean() - of.cx) / of.fx
        return [-x if variant.mirrored and of is own else x, (rows.mean() - of.cy) / of.fy]

    assert ray(picture, own) == pytest.approx(ray(photo, camera), abs=1e-3)
