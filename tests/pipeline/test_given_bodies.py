"""Bodies that the user gives: whose they are, what the engine keeps of them, and wrong ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from physic_core import ConfigError, InputError, read_bodies, write_bodies
from physic_core.types import Bodies, FileOfPhoto
from physic_mock import backends
from physic_testing.worlds import load_world
from tests.pipeline.mocks import changed, run, without_people

pytestmark = pytest.mark.usefixtures("few_steps")

SIZE = (160, 120)


@pytest.fixture(scope="module")
def group():
    """A small photo of four people."""
    return load_world("group", SIZE)


def written(folder, world, camera=None, rows=slice(None), **changes):
    """The bodies of a world, or some of them, changed, in the project's own format."""
    path = folder / "people.npz"
    parameters = replace(world.parameters, **changes)[rows]
    write_bodies(path, parameters, world.body_model, camera or world.intrinsics)
    return path


def result(world, path, *settings, **given):
    return run(world.image, f"photo.bodies={path}", *settings, intrinsics=world.intrinsics, **given)


def distances(one, joints):
    return np.linalg.norm(one.joints - joints, axis=-1)


def test_own_file_is_read_as_it_was_written(tmp_path, world):
    camera = world.intrinsics
    file = FileOfPhoto(written(tmp_path, world), "", (camera.width, camera.height))
    found = read_bodies(file)
    for name, value in vars(world.parameters).items():
        np.testing.assert_array_equal(getattr(found.bodies.parameters, name), value)
    np.testing.assert_allclose(found.camera, [[camera.fx, camera.fy, camera.cx, camera.cy]])


def test_true_bodies_stay_where_they_are(tmp_path, group):
    found = result(group, written(tmp_path, group))
    assert len(found.people) == 4
    order = np.argsort(group.boxes[:, 0] + group.boxes[:, 2])
    for person, i in zip(found.people, order, strict=True):
        assert person.body_source == "people.npz"
        np.testing.assert_allclose(person.given_joints, group.joints[i], atol=1e-4)
        assert distances(person, group.joints[i]).mean() < 0.05


def moved_by_a_pixel(keypoints, *_):
    """All keypoints 1 px off, which is 25 mm at the person."""
    return replace(keypoints, points=keypoints.points + np.float32([1, 0]))


def test_stated_error_decides_between_the_place_of_a_body_and_of_keypoints(tmp_path, world):
    off = []
    for sigma in (0.005, 0.4):
        found = run(
            world.image,
            f"photo.bodies={written(tmp_path, world)}",
            f"photo.bodies_sigma={sigma}",
            "engine.joint.optimiser.steps=20",
            intrinsics=world.intrinsics,
            backends=changed(backends.MockKeypointDetector, moved_by_a_pixel),
        )
        off.append(found.people[0].joints[0, 0] - world.joints[0, 0, 0])
    assert off[0] < 0.005 < 0.018 < off[1]


def test_final_bodies_keep_pose_and_shape_and_are_all_people(tmp_path, group):
    found = result(group, written(tmp_path, group, rows=[1, 2]), "photo.bodies_final=true")
    assert len(found.people) == 2
    for person in found.people:
        own = person.joints - person.joints[:1]
        given = person.given_joints - person.given_joints[:1]
        np.testing.assert_allclose(own, given, atol=1e-4)


def test_others_have_estimated_bodies(tmp_path, group):
    found = result(group, written(tmp_path, group, rows=[2]))
    sources = [person.body_source for person in found.people]
    assert len(sources) == 4
    assert sorted(filter(None, sources)) == ["people.npz"]


def test_body_without_a_person_becomes_one(tmp_path, world):
    found = run(
        world.image,
        f"photo.bodies={written(tmp_path, world)}",
        intrinsics=world.intrinsics,
        backends=changed(backends.MockSegmenter, without_people),
    )
    (person,) = found.people
    both = (person.mask & world.masks[0]).sum() / (person.mask | world.masks[0]).sum()
    assert both > 0.8
    assert person.body_source == "people.npz"


def as_a_crop_tool_places(joints, camera, focal_px):
    """The translation (3,) from joints in a camera to those of a network that guesses the focal
    length: joints are on their pixels as well as they can be.
    """
    middle = joints.mean(0) * [0, 0, focal_px / camera.fx - 1]

    def pixels(points, focal):
        return points[:, :2] / points[:, 2:] * focal

    def off(move):
        moved = joints + middle + move * [1, 1, focal_px / camera.fx]
        return (pixels(moved, focal_px) - pixels(joints, camera.fx)).ravel()

    return middle + least_squares(off, np.zeros(3)).x * [1, 1, focal_px / camera.fx]


@pytest.mark.parametrize("focal", [5000 / 256, 5000 / 192, 0.866])
def test_body_of_a_guessed_camera_keeps_its_pixels_and_gets_our_distance(tmp_path, world, focal):
    """4D-Humans, SMPLer-X and Multi-HMR: focal lengths in sides of the picture."""
    true, camera = world.joints[0, :22].astype(float), world.intrinsics
    focal_px = focal * SIZE[0]
    moved = world.parameters.transl + as_a_crop_tool_places(true, camera, focal_px)
    guessed = replace(camera, fx=focal_px, fy=focal_px)
    found = result(world, written(tmp_path, world, guessed, transl=moved.astype(np.float32)))
    given = found.people[0].given_joints[:22]
    pixels = [camera.fx * each[:, :2] / each[:, 2:] for each in (given, true)]
    assert np.linalg.norm(pixels[0] - pixels[1], axis=1).max() < 2 * SIZE[0] / 1920
    assert given[0, 2] == pytest.approx(true[0, 2], rel=0.01)
    distance, sigma = found.people[0].joints[0, 2], found.distance_sigmas[0]
    assert abs(np.log(distance / true[0, 2])) < 2 * sigma < 0.5


def test_record_in_python_is_of_the_photos_camera(world):
    given = Bodies(world.parameters, world.body_model)
    found = run(world.image, intrinsics=world.intrinsics, bodies=given)
    np.testing.assert_allclose(found.people[0].given_joints, world.joints[0], atol=1e-4)
    with pytest.raises(ConfigError, match="camera"):
        run(world.image, bodies=given)


def test_masks_choose_the_people(tmp_path, group):
    masks = group.masks[[2, 0]]
    np.savez(tmp_path / "masks.npz", masks=masks)
    for found in (
        run(group.image, f"photo.masks={tmp_path / 'masks.npz'}", intrinsics=group.intrinsics),
        run(group.image, masks=masks, intrinsics=group.intrinsics),
    ):
        for person, mask in zip(found.people, masks, strict=True):
            np.testing.assert_array_equal(person.mask, mask)


@pytest.mark.parametrize("what", ["inverted", "upside down", "mirrored"])
def test_masks_of_another_reading_are_named(group, what):
    turned = {"inverted": ~group.masks.any(0)[None], "upside down": group.masks[:, ::-1]}
    masks = turned.get(what, group.masks[..., ::-1])
    with pytest.raises(InputError, match=what):
        run(group.image, masks=masks, intrinsics=group.intrinsics)


def test_a_known_stature_resizes_a_given_body(tmp_path, world):
    found = result(world, written(tmp_path, world), "photo.stature=1.9")
    assert found.people[0].stature == pytest.approx(1.9, rel=0.01)


def test_bodies_of_a_smaller_picture_are_scaled(tmp_path, world):
    small = world.intrinsics.resized(80, 60)
    found = result(world, written(tmp_path, world, small))
    np.testing.assert_allclose(found.people[0].given_joints, world.joints[0], atol=1e-3)
