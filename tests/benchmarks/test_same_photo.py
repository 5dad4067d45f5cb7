"""``benchmarks/same_photo``: known answers come out as these changes, and examples keep their
lens.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.same_photo import PHOTO, VARIANTS, Variant, answer_of, change
from physic_core.types import Intrinsics

WIDTH = 640
HEIGHT = 480
ALL = (*VARIANTS, Variant("crop", margin=0.08))
BY_NAME = {variant.name: variant for variant in ALL}


def people(mirrored=False):
    """A person at the left and 4 m away."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[100:400, 50:200] = True
    joints = np.array([[1.0 if mirrored else -1.0, 0.2, 4.0]])
    mask = mask[:, ::-1] if mirrored else mask
    return [SimpleNamespace(mask=mask, joints=joints, usable=("pose",))]


def answer(variant=PHOTO, **how):
    return answer_of(people(**how), variant, WIDTH, HEIGHT)


def test_the_mirrored_result_of_a_mirrored_photo_is_no_change():
    found = change(answer(), answer(BY_NAME["mirror"], mirrored=True))
    assert (found.visible, found.lost, found.new, len(found.people)) == (1, 0, 0, 1)
    assert found.people[0].distance == pytest.approx(0)


def test_what_is_changed_by_hand_is_measured():
    (person,) = answer().people
    moved = replace(person, distance=1.1 * person.distance, usable=())
    found = change(answer(), replace(answer(), people=(moved,)))
    assert np.exp(found.people[0].distance) == pytest.approx(1.1)
    assert found.people[0].usable == (("pose",), ())


@pytest.mark.parametrize("name", ["crop", "column", "scale"])
def test_the_part_of_a_result_that_a_variant_shows_is_no_change(name):
    left, top, right, bottom = BY_NAME[name].window(WIDTH, HEIGHT)
    (person,) = people()
    person.mask = person.mask[top:bottom, left:right]
    found = change(answer(), answer_of([person], BY_NAME[name], WIDTH, HEIGHT))
    assert (found.visible, found.lost, found.new) == (1, 0, 0)


def test_a_person_whom_a_crop_cuts_off_is_not_missed():
    variant = Variant("left half gone", margin=0.4)
    found = change(answer(), answer_of([], variant, WIDTH, HEIGHT))
    assert (found.visible, found.lost, found.new) == (0, 0, 0)


@pytest.mark.parametrize("variant", ALL, ids=lambda variant: variant.name)
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
