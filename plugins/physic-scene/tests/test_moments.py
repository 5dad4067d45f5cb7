"""Photos of worlds with several cameras become one scene, and each photo that does not belong has its reason."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from physic_core import Pipeline, load_config
from physic_core.errors import ConfigError, InputError
from physic_core.interfaces import INTERFACES
from physic_scene import Scene, SceneResult
from physic_scene.command import scene as command
from physic_scene.rigid import angle_deg
from physic_testing.worlds import build_world, view_names

SIZE = (240, 180)
QUIET = {name: {"options": {"noise": 0.25}} for name in INTERFACES}


@pytest.fixture(scope="module")
def config():
    return load_config(preset="mock", flags={"noise": QUIET})


@pytest.fixture(scope="module")
def worlds():
    return [build_world(name, 4, SIZE) for name in view_names("hug", 3)]


@pytest.fixture(scope="module")
def alone(config, worlds):
    """Return the result of each photo alone."""
    with Pipeline(config) as pipeline:
        return [pipeline(world.image) for world in worlds]


@pytest.fixture(scope="module")
def solver(config):
    with Scene(config) as scene:
        yield scene


@pytest.fixture(scope="module")
def solved(solver, alone) -> SceneResult:
    return solver.join(alone, ["a.png", "b.png", "c.png"])


def test_three_photos_give_their_cameras(solved, worlds):
    first = worlds[solved.reference].camera
    assert [camera.photo for camera in solved.cameras] == ["a.png", "b.png", "c.png"]
    for camera in solved.cameras:
        world = worlds[camera.index].camera
        assert angle_deg(camera.rotation, world.rotation @ first.rotation.T) < 10
        away = np.linalg.norm(first.to_camera(world.position))
        assert np.linalg.norm(camera.centre) == pytest.approx(away, rel=0.25, abs=1e-6)


def test_each_person_is_one_person_in_all_photos(solved):
    assert len(solved.people) == 2
    assert all(person.views == (0, 1, 2) and not person.moved for person in solved.people)
    for camera in solved.cameras:
        assert sorted(camera.people) == [0, 1]


def test_the_reference_result_is_a_complete_reconstruction(solved, alone):
    result = solved.reconstruction
    assert len(result.people) == 2
    assert result.photo == alone[solved.reference].photo
    assert any(person.contact.any() for person in result.people)
    assert all(person.grade is not None for person in result.people)
    assert len(solved.points) == len(solved.colors) > 1000


def test_the_same_photo_twice_is_one_view(solver, alone):
    found = solver.join([alone[0], alone[1], alone[0]], ["a.png", "b.png", "again.png"])
    assert [(one.photo, one.reason) for one in found.left_out] == [("again.png", "same photo")]
    assert found.left_out[0].message == "again.png is left out: it is the same picture as a.png"
    assert len(found.cameras) == 2


def test_a_photo_of_other_people_is_left_out(solver, config, alone):
    with Pipeline(config) as pipeline:
        other = pipeline(build_world("sit_on_floor", 3, SIZE).image)
    found = solver.join([*alone, other], ["a.png", "b.png", "c.png", "other.png"])
    assert [(one.photo, one.reason) for one in found.left_out] == [("other.png", "other people")]
    assert len(found.cameras) == 3


def test_photos_without_a_common_person_are_refused(solver, config, alone):
    with Pipeline(config) as pipeline:
        other = pipeline(build_world("sit_on_floor", 3, SIZE).image)
    message = r"no two of the photos show the same person in the same pose \(a.png, other.png\)"
    with pytest.raises(InputError, match=message):
        solver.join([alone[0], other], ["a.png", "other.png"])


def test_a_photo_without_people_is_left_out(solver, alone):
    found = solver.join([*alone[:2], None, replace(alone[2], people=())], ["a.png", "b.png", "none.png", "empty.png"])
    assert [(one.photo, one.reason) for one in found.left_out] == [
        ("none.png", "no people"),
        ("empty.png", "no people"),
    ]


@pytest.mark.parametrize("count", [0, 1, 9])
def test_a_scene_has_two_to_eight_photos(solver, alone, count):
    with pytest.raises(InputError, match=f"a scene needs 2 to 8 photos of one moment, got {count}"):
        solver.join([alone[0]] * count)


def test_another_energy_is_refused(alone):
    table = {"extends": "mock", "engine": {"preset": "paper"}}
    with Scene(table) as other, pytest.raises(ConfigError, match=r"physic scene solves with engine\.preset 'default'"):
        other.join(alone[:2])


def test_save_writes_the_result_and_the_cameras(solved, tmp_path):
    solved.save(str(tmp_path / "out"))
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"reconstruction.json", "cameras.json", "scene_points.ply", "photos.png", "preview.png"} <= names
    document = json.loads((tmp_path / "out" / "cameras.json").read_text())
    assert document["version"] == 1
    assert [camera["photo"] for camera in document["cameras"]] == ["a.png", "b.png", "c.png"]
    assert np.allclose(document["cameras"][1]["rotation"], solved.cameras[1].rotation, atol=1e-5)
    with Image.open(tmp_path / "out" / "photos.png") as picture:
        assert picture.height > 3 * 300


def test_the_command_names_what_is_wrong(tmp_path):
    run = CliRunner().invoke(command, ["a.png", "b.png", "-o", str(tmp_path / "out")])
    assert isinstance(run.exception, InputError)
    assert str(run.exception) == "there is no file a.png: name two to eight photos of one moment"
    run = CliRunner().invoke(command, ["a.png", "b.png", "-o", "out", "--intrinsics", "1,2,3,4"])
    assert "--intrinsics: give it once for each of the 2 photos, - where unknown" in run.output
