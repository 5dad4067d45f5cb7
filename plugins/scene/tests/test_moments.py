"""Photos of worlds with several cameras become one scene, and each photo that does not belong has
its reason.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from PIL import Image

from physic_core import load_config, load_reconstruction, write_bodies
from physic_core.body import load_body
from physic_core.errors import ConfigError, InputError, OutputError
from physic_core.interfaces import INTERFACES
from physic_scene import ScenePipeline
from physic_scene.checks import checks_of_keypoints, with_checks
from physic_scene.command import scene as command
from physic_scene.output import save_scene
from physic_scene.rigid import rotation_angle_deg
from physic_testing.worlds import load_world

pytestmark = pytest.mark.slow

SIZE = (240, 180)
QUIET = {name: {"options": {"noise": 0.25}} for name in INTERFACES}


NAMES = ["a.png", "b.png", "c.png"]


@pytest.fixture(scope="module")
def solver():
    steps = ["engine.joint.optimiser.steps=10"]
    with ScenePipeline(
        load_config(preset="mock", flags={"noise": QUIET}, overrides=steps)
    ) as scene:
        yield scene


@pytest.fixture(scope="module")
def worlds():
    return [load_world(f"hold_hands_view{i}", SIZE) for i in (1, 2, 3)]


@pytest.fixture(scope="module")
def alone(solver, worlds):
    """Return the result of each photo alone."""
    return [solver.reconstruct_photo(world.image) for world in worlds]


@pytest.fixture(scope="module")
def solved(solver, alone):
    return solver.join_photos(alone, NAMES)


def camera_errors(photo, worlds, reference):
    """Return how far a camera is from that of its world, in metres and degrees."""
    first = worlds[reference]
    true = worlds[photo.index]
    centre = first.camera_rotation @ (true.camera_position - first.camera_position)
    turn = true.camera_rotation @ first.camera_rotation.T
    away = np.linalg.norm(photo.camera.centre - centre)
    return away, rotation_angle_deg(photo.camera.rotation, turn)


def test_three_photos_give_their_cameras_and_a_check_of_each(solved, worlds):
    assert not solved.reconstruction.warnings
    first = worlds[solved.reference]
    assert [photo.name for photo in solved.photos] == NAMES
    for photo in solved.photos:
        away = np.linalg.norm(worlds[photo.index].camera_position - first.camera_position)
        assert np.linalg.norm(photo.camera.centre) == pytest.approx(away, rel=0.25, abs=1e-6)
        assert camera_errors(photo, worlds, solved.reference)[1] < 10
    checks = [check for check in solved.reconstruction.checks if check.name == "view_keypoints"]
    others = [photo.name for photo in solved.photos if photo.index != solved.reference]
    assert [check.title for check in checks] == [
        f"Limbs far from their keypoints in {photo}" for photo in others
    ]
    assert all(check.ok and check.value is not None for check in checks)


@pytest.mark.parametrize("statures", [(1.65, 0.0), (1.65,)])
def test_a_known_stature_is_that_of_the_result(solver, alone, statures):
    result = solver.join_photos(alone, NAMES, statures=statures).reconstruction
    people = sorted(result.people, key=lambda person: person.box[0] + person.box[2])
    betas = torch.tensor(np.concatenate([person.parameters.betas for person in people]))
    found = load_body("embedded").stature(betas).tolist()
    for stature, given in zip(found, statures if len(statures) > 1 else 2 * statures, strict=True):
        assert not given or stature == pytest.approx(given, rel=0.005)
    assert [size["given"] for size in result.diagnostics["known_sizes"]] == [1.65] * (
        3 - len(statures)
    )


@pytest.fixture(scope="module")
def poses(worlds):
    """Return the true poses (4, 4) of the cameras of the worlds."""
    found = []
    for world in worlds:
        pose = np.eye(4)
        pose[:3, :3] = world.camera_rotation.T
        pose[:3, 3] = world.camera_position
        found.append(pose)
    return found


@pytest.mark.parametrize("known", [(0, 1, 2), (0, 2)])
def test_known_cameras_stay_and_give_the_scale(solver, alone, worlds, poses, known):
    given = [pose if v in known else None for v, pose in enumerate(poses)]
    found = solver.join_photos(alone, NAMES, poses=given)
    assert found.reference in known
    for photo in found.photos:
        most = (1e-3, 0.05) if photo.index in known else (0.5, 10)
        assert (np.array(camera_errors(photo, worlds, found.reference)) < most).all()
    assert found.reconstruction.scene.scale == 1.0
    names = ", ".join(NAMES[v] for v in known)
    assert any(
        note.startswith(f"the poses of {names} are known, and give")
        for note in found.reconstruction.notes
    )


def test_known_cameras_in_another_unit_are_refused(solver, alone, poses):
    centimetres = [np.vstack([pose[:3] * [1, 1, 1, 100], pose[3]]) for pose in poses]
    with pytest.raises(InputError, match=r"not in meters.*camera-unit"):
        solver.join_photos(alone, poses=centimetres)


def test_photos_that_do_not_belong_are_left_out_with_their_reasons(solver, alone):
    other = solver.reconstruct_photo(load_world("squat", SIZE).image)
    empty = replace(alone[2], people=())
    reasons = {
        "none.png": "no people",
        "again.png": "same photo",
        "empty.png": "no people",
        "other.png": "does not fit",
    }
    found = solver.join_photos([*alone, None, alone[0], empty, other], [*NAMES, *reasons])
    assert {one.photo: one.reason for one in found.left_out} == reasons
    assert {one.message for one in found.left_out} <= set(found.reconstruction.warnings)


def stepped_aside(result, metres):
    """Return a result whose last person stands elsewhere, as far from the camera."""
    person = result.people[-1]
    K = result.intrinsics.matrix
    step = np.array([metres, 0, 0], np.float32)
    pixels = np.array([K[0, 0] * metres / person.joints[0, 2], 0])
    moved = replace(
        person,
        parameters=replace(person.parameters, transl=person.parameters.transl + step),
        vertices=person.vertices + step,
        mask=np.roll(person.mask, round(pixels[0]), axis=1),
        keypoints=(person.keypoints + pixels).astype(person.keypoints.dtype),
    )
    return replace(result, people=(*result.people[:-1], moved))


def test_a_person_who_moved_is_named_and_is_in_the_reference_alone(solver):
    *others, third = (
        solver.reconstruct_photo(load_world(f"group_view{i}", SIZE).image) for i in (1, 2, 3)
    )
    found = solver.join_photos([*others, stepped_aside(third, 0.8)], NAMES)
    (note,) = (note for note in found.reconstruction.notes if "moved" in note)
    assert "a.png" in note
    assert "c.png" in note  # one is not found in b.png
    shown = [row for photo in found.photos for row in photo.shown]
    assert [shown.count(row) for row in range(len(found.reconstruction.people))].count(1) == 1
    assert not found.left_out


def test_photos_without_a_common_person_are_refused_or_bad(solver, alone):
    """One who kneels may fit one who stands within the errors of keypoints; then a check says that
    they are unlike.
    """
    other = solver.reconstruct_photo(load_world("kneel", SIZE).image)
    try:
        found = solver.join_photos([alone[0], other], ["a.png", "other.png"]).reconstruction
    except InputError as error:
        assert "no person of a.png can be where other.png shows one" in str(error)  # noqa: PT017
    else:
        assert not found.usable["place"]
        assert any(check.failed for check in found.checks if check.name == "view_agreement")


@pytest.mark.parametrize(
    ("rows", "error", "words"),
    [
        ((0, 0), InputError, "only a.png"),
        ((None, None), InputError, "none is left"),
        ((0,), ConfigError, "got 1"),
        (9 * (0,), ConfigError, "got 9"),
    ],
)
def test_two_to_eight_different_photos_with_people_are_needed(solver, alone, rows, error, words):
    photos = [None if row is None else alone[row] for row in rows]
    with pytest.raises(error, match=words):
        solver.join_photos(photos, len(rows) * ["a.png"])


def test_another_energy_is_refused():
    with pytest.raises(ConfigError, match=r"engine\.preset"):
        ScenePipeline({"extends": "mock", "engine": {"preset": "paper"}})


def test_each_photo_shows_the_people_where_its_camera_sees_them(solved):
    for photo in solved.photos:
        assert sorted(photo.shown) == [0, 1]
        for row, own in photo.shown.items():
            joints = solved.reconstruction.people[row].joints[:1]
            pixels = photo.camera.to_camera(joints) @ photo.camera.intrinsics.matrix.T
            x, y = pixels[0, :2] / pixels[0, 2]
            rows, columns = np.nonzero(photo.result.people[own].mask)
            assert np.maximum(abs(rows - y), abs(columns - x)).min() < 12


def test_a_camera_that_is_wrong_is_named(solved):
    first, second = (photo for photo in solved.photos if photo.index != solved.reference)
    aside = replace(first.camera, translation=first.camera.translation + np.array([1.0, 0.0, 0.0]))
    wrong, right = checks_of_keypoints(
        solved.reconstruction, [replace(first, camera=aside), second]
    )
    assert (wrong.failed, right.failed) == (True, False)
    assert f"not where {first.name} shows them" in wrong.message
    doubtful = with_checks(solved.reconstruction, [wrong, right])
    assert not doubtful.usable["place"]
    assert wrong.message in doubtful.warnings


def test_save_writes_the_result_and_its_cameras(solved, tmp_path):
    save_scene(solved, str(tmp_path / "out"))
    assert (tmp_path / "out" / "people.csv").exists()
    assert len(load_reconstruction(tmp_path / "out").people) == 2
    document = json.loads((tmp_path / "out" / "cameras.json").read_text())
    assert document["photos"][0]["rotation"] == np.eye(3).tolist()
    for one in document["photos"]:
        photo = next(photo for photo in solved.photos if photo.name == one["photo"])
        assert one["translation"] == photo.camera.translation.tolist()
        assert one["intrinsics"]["fx"] == photo.camera.intrinsics.fx
        assert one["people"] == list(photo.shown)
    with Image.open(tmp_path / "out" / "photos.png") as picture:
        assert picture.height > 3 * 400


def test_a_picture_of_the_photos_that_fails_is_a_warning(solved, tmp_path, monkeypatch):
    monkeypatch.setattr("physic_scene.output.photos_png", lambda scene: 1 / 0)
    save_scene(solved, str(tmp_path / "out"))
    assert "photos.png failed" in load_reconstruction(tmp_path / "out").warnings[-1]


def test_a_moment_replaces_the_result_of_each_of_its_photos(solved, alone, tmp_path):
    others = [index for index, one in enumerate(alone) if one.photo != solved.reconstruction.photo]
    alone[others[0]].save(str(tmp_path / "out"), "numbers")
    with pytest.raises(OutputError, match="the result of another photo"):
        save_scene(solved, str(tmp_path / "out"))
    for _ in range(2):  # the second time with the files of a scene, which are of the result too
        save_scene(solved, str(tmp_path / "out"), photos=" ".join(one.photo for one in alone))
    assert load_reconstruction(tmp_path / "out").photo == solved.reconstruction.photo


@pytest.fixture
def run(tmp_path):
    """Return a function that runs the command on photos of a folder, by their names."""

    def invoke(*names, options=()):
        photos = [str(tmp_path / name) for name in names]
        arguments = [*photos, "-o", str(tmp_path / "out"), "--preset", "mock", *options]
        return CliRunner().invoke(command, arguments)

    return invoke


@pytest.mark.parametrize("name", ["cameras.json", "photos.png", "preview.png"])
def test_the_command_replaces_no_file_of_the_user(name, tmp_path, run):
    for photo, grey in (("a.png", 10), ("b.png", 20)):
        Image.new("L", (80, 80), grey).save(tmp_path / photo)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("mine")
    failed = run("a.png", "b.png", options=["--overwrite"])
    assert isinstance(failed.exception, OutputError)
    assert f"{name} there was not written by a run" in str(failed.exception)
    (path,) = (tmp_path / "out").iterdir()
    assert (path.name, path.read_text()) == (name, "mine")


def test_the_command_writes_result_cameras_and_page(worlds, tmp_path, run):
    for name, world in zip(NAMES[:2], worlds, strict=False):
        Image.fromarray(world.image).save(tmp_path / name)
    out = tmp_path / "out"
    done = run(*NAMES[:2], options=["--set", "engine.joint.optimiser.steps=3"])
    assert done.exit_code == 0, done.output
    assert f"page: {out / 'report.html'}" in done.stdout.splitlines()
    files = {path.name for path in out.iterdir()}
    assert {"reconstruction.json", "cameras.json", "photos.png", "report.html"} <= files
    Image.fromarray(worlds[0].image[::-1]).save(tmp_path / "c.png")
    assert "--overwrite" in str(run("c.png", "c.png").exception)


def test_given_bodies_and_masks_are_those_of_their_photos(worlds, tmp_path, run):
    options = ["--set", "engine.joint.optimiser.steps=2", "--set", "photo.bodies_final=true"]
    for name, world in zip("ab", worlds, strict=False):
        Image.fromarray(world.image).save(tmp_path / f"{name}.png")
        bodies, masks = tmp_path / f"{name}.npz", tmp_path / f"{name}_masks.npz"
        write_bodies(bodies, world.parameters, world.body_model, world.intrinsics)
        np.savez(masks, masks=world.masks)
        options += ["--bodies", str(bodies), "--masks", str(masks)]
    done = run("a.png", "b.png", options=options)
    assert done.exit_code == 0, done.output
    people = load_reconstruction(tmp_path / "out").people
    assert len(people) == 2
    assert len({person.body_source for person in people} & {"a.npz", "b.npz"}) == 1
    one_of_two = run("a.png", "b.png", options=options[:6])
    assert one_of_two.exit_code == 2
    assert "once for each" in one_of_two.output
