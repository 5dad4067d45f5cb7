"""The pipeline at its doors: cameras in, and answers of backends that the interfaces do not
allow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import Reconstruction, reconstruct
from physic_core.configuration.model import OPTIONAL_INTERFACES, PhotoSettings
from physic_core.errors import ConfigError
from physic_core.io.photo import Photo
from physic_core.prepare.photo import prepare_photo
from physic_core.types import Intrinsics
from physic_core.types.observations import POSTURES
from physic_mock import backends
from tests.pipeline.mocks import changed, run

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("few_steps")]


def test_point_maps_get_the_photo_beside_the_inpainted_one(world):
    calls = []

    def look(found, image, hints):
        calls.append((np.array_equal(image, world.image), hints))
        return found

    reconstruct(world.image, "mock", backends=changed(backends.MockRelativePointmap, look))
    # a strange backend is asked its first question twice
    (same_first, first), *_, (same_second, second) = calls
    assert (same_first, same_second) == (False, True)
    assert np.array_equal(first.photo, world.image)
    assert second.photo is None


def test_bodies_of_another_body_model(world):
    smplx = changed(
        backends.MockBodyEstimator, lambda found, *_: replace(found, body_model="smplx")
    )
    with pytest.raises(ConfigError, match="'smplx', but the configuration loads 'embedded': set "):
        reconstruct(world.image, "mock", backends=smplx)


def test_optional_interfaces_may_be_left_out(world):
    steps = []
    none = [f"{name}.backend=none" for name in OPTIONAL_INTERFACES]
    result = run(world.image, *none, progress=lambda *step: steps.append(step))
    assert [s.name for s in result.stages] == [name for name, _, _ in steps]
    assert [done for _, done, _ in steps] == list(range(len(steps)))
    assert {total for _, _, total in steps} == {len(steps)}
    assert np.abs(result.people[0].parameters.left_hand_pose).max() < 0.05


def test_what_the_person_observer_says_is_in_the_result_and_saved(world, tmp_path):
    reconstruct(world.image, "mock").save(str(tmp_path), "numbers")
    (person,) = Reconstruction.load(str(tmp_path)).people
    assert person.posture == "stand"
    assert person.posture_probability > 0.9
    assert person.child_probability < 0.1


@pytest.mark.parametrize(("seat", "posture"), [(0.02, None), (0.95, "lie")])
def test_nobody_lies_on_feet_and_hands_alone(world, seat, posture):
    def lying(said, *_):
        sure = np.array([[name == "lie" for name in POSTURES]], np.float32)
        touch = said.touch.copy()
        touch[0, :5, 0] = 0.98, 0.98, 0.98, 0.98, seat
        touch[0, :5, 1:] = (1 - touch[0, :5, :1]) / 4
        return replace(said, posture=sure, touch=touch)

    lies = changed(backends.MockPersonObserver, lying)
    (person,) = reconstruct(world.image, "mock", backends=lies).people
    assert person.posture == posture


def prepared_camera(photo, **settings):
    return prepare_photo(photo, PhotoSettings(**settings), None, None).photo.intrinsics


def test_a_configured_camera_is_in_pixels_of_the_file():
    reduced = Photo(np.zeros((100, 200, 3), np.uint8), None, (), file_size=(400, 200))
    given = prepared_camera(reduced, focal_px=500)
    assert (given.fx, given.cx, given.cy, given.width, given.height) == (250, 99.5, 49.5, 200, 100)
    given = prepared_camera(reduced, intrinsics=(500, 400, 199.5, 99.5))
    assert (given.fx, given.fy, given.cx, given.cy) == (250, 200, 99.5, 49.5)


REDUCED = Photo(np.zeros((71, 107, 3), np.uint8), file_size=(1920, 1278))


@pytest.mark.parametrize(
    ("intrinsics", "size", "right"),
    [
        ((1306, 1306, 767.5, 510.9), "1536 x 1023 px,", "1632,1632,959"),
        ((1640, 1632, 638.5, 959.5), "1278 x 1920 px, turned", "1632,1640,960,638"),
        ((816, 820, 319, 479.5), "639 x 960 px, turned", "1640,1632"),
    ],
)
def test_intrinsics_of_another_size_of_the_picture_are_refused(intrinsics, size, right):
    with pytest.raises(ConfigError) as caught:
        prepared_camera(REDUCED, intrinsics=intrinsics)
    assert size in str(caught.value)
    assert right in str(caught.value)


@pytest.mark.parametrize("centre", [(959.5, 638.5), (1010, 600), (1300, 500), (700, 638.5)])
def test_intrinsics_of_a_lens_or_of_a_crop_are_taken(centre):
    assert prepared_camera(REDUCED, intrinsics=(1632, 1632, *centre)) is not None


def test_a_configured_camera_wins_over_the_files():
    photo = Photo(np.zeros((100, 200, 3), np.uint8), Intrinsics.from_focal(111, 200, 100, "EXIF"))
    assert prepared_camera(photo) == photo.intrinsics
    chosen = prepared_camera(photo, focal_px=222)
    assert (chosen.fx, chosen.source) == (222, "given")
