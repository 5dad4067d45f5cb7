"""Results out and back in: whole, nearly exact, and never half."""

from __future__ import annotations

import errno
import json
import math
import os
import tempfile
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import physic_core.io.results as results
from physic_core import load_people, load_reconstruction, save_reconstruction
from physic_core.cache.digests import Digester
from physic_core.errors import ConfigError, InputError, OutputError
from physic_core.files.atomic import check_writable
from physic_core.io.result_folder import digest_of, is_result
from physic_core.io.results import read_image
from physic_core.types import person_rows

pytestmark = pytest.mark.quick


def digest(result):
    """Of all that a result holds, to the last bit."""
    return Digester().digest(result)


def on_rays(result):
    """Return a result whose points lie on the rays of their pixels, as those of the engine do."""
    K = result.intrinsics
    z = result.scene.points[..., 2].astype(np.float32)
    x = (np.arange(K.width) - K.cx) / K.fx
    y = (np.arange(K.height) - K.cy) / K.fy
    points = np.stack([z * x, z * y[:, None], z], -1).astype(np.float32)
    return replace(result, scene=replace(result.scene, points=points))


# --- there and back
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("people", [0, 1, 2])
def test_load_gives_back_what_save_took(tmp_path, make, people):
    before = on_rays(make(people=people))
    save_reconstruction(before, tmp_path, "numbers")
    after = load_reconstruction(tmp_path)
    valid = before.scene.valid
    z = before.scene.points[..., 2]
    assert (np.abs(after.scene.points - before.scene.points).max(-1)[valid] / z[valid]).max() < 2e-5
    assert np.abs(after.scene.floor_points - before.scene.floor_points).max() < 1e-6
    known = np.abs(before.scene.normals).any(-1)
    cosine = (after.scene.normals * before.scene.normals).sum(-1)[known]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max(initial=0) < 0.4
    assert not after.scene.normals[~known].any()
    exact = {name: getattr(before.scene, name) for name in ("points", "normals", "floor_points")}
    bodies = []
    for one, other in zip(after.people, before.people, strict=True):
        assert (
            max(np.abs(getattr(one, n) - getattr(other, n)).max() for n in ("vertices", "joints"))
            < 1e-6
        )
        bodies.append(replace(one, vertices=other.vertices, joints=other.joints))
    whole = replace(after, scene=replace(after.scene, **exact), people=tuple(bodies))
    assert digest(whole) == digest(before)


def test_a_second_save_loses_nothing_more(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path / "a", "numbers")
    once = load_reconstruction(tmp_path / "a")
    save_reconstruction(once, tmp_path / "b", "numbers")
    assert digest(load_reconstruction(tmp_path / "b")) == digest(once)


def test_points_that_are_not_on_their_rays_are_kept(tmp_path, reconstruction):
    moved = replace(
        reconstruction.scene, points=on_rays(reconstruction).scene.points + np.float32(0.01)
    )
    save_reconstruction(replace(reconstruction, scene=moved), tmp_path, "numbers")
    np.testing.assert_array_equal(load_reconstruction(tmp_path).scene.points, moved.points)


def test_numbers_that_are_not_finite_survive(tmp_path, reconstruction):
    person = replace(
        reconstruction.people[0],
        score=math.nan,
        vertices=reconstruction.people[0].vertices * np.nan,
    )
    save_reconstruction(replace(reconstruction, people=(person,)), tmp_path, "numbers")
    after = load_reconstruction(tmp_path).people[0]
    assert math.isnan(after.score)
    assert np.isnan(after.vertices).all()


# --- what lies in the folder
# ------------------------------------------------------------------------------------------


def test_a_word_that_names_no_files_is_refused(tmp_path, reconstruction):
    with pytest.raises(ConfigError, match="pictures, numbers, people"):
        save_reconstruction(reconstruction, tmp_path, "everything")


def test_the_second_coordinate_in_the_world_is_the_height_over_the_floor(reconstruction):
    floor = reconstruction.scene.floor
    points = np.random.default_rng(0).normal(size=(5, 3))
    heights = points @ floor.normal + floor.offset
    np.testing.assert_allclose(reconstruction.in_world(points)[:, 1], heights)
    camera, ahead = reconstruction.in_world(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(camera, [0.0, floor.offset, 0.0], atol=1e-12)
    assert ahead[2] < camera[2]


def test_the_document_states_units_frame_and_camera(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "numbers")
    text = (tmp_path / "reconstruction.json").read_text(encoding="utf-8")
    document = json.loads(text, parse_constant=pytest.fail)
    assert "meters" in document["frame"]["units"]
    assert "x right, y down, z forward" in document["frame"]["axes"]
    world = reconstruction.world_from_camera
    np.testing.assert_allclose(document["frame"]["world_from_camera"], world)
    assert document["intrinsics"]["fx"] == reconstruction.intrinsics.fx
    assert document["rows"] == json.loads(json.dumps(person_rows(reconstruction)))
    assert document["stages"][0]["provenance"]["options"]["limit"] == "Infinity"
    assert document["config"] == reconstruction.config
    # readable, not escaped
    assert "–" in text


def test_the_arrays_of_people_can_be_read_alone(tmp_path, reconstruction):
    for save in ("numbers", "people"):
        save_reconstruction(reconstruction, tmp_path / save, save)
        arrays = load_people(tmp_path / save)
        assert np.abs(arrays["people.1.vertices"] - reconstruction.people[1].vertices).max() < 1e-6
        assert {"faces", "people.0.parameters.body_pose"} <= set(arrays)
        assert not [name for name in arrays if name.startswith(("scene", "image"))]
    with pytest.raises(InputError, match="load_people"):
        load_reconstruction(tmp_path / "people")


# --- a folder that was used before
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "cure"),
    [(errno.ENOSPC, "No space left on device.*free space"), (errno.EACCES, "who may write there")],
)
def test_a_folder_that_takes_no_file_is_refused_with_the_cure(tmp_path, monkeypatch, number, cure):
    def refuse(dir):
        raise OSError(number, os.strerror(number), str(dir))

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    with pytest.raises(OutputError, match=cure):
        check_writable(tmp_path)


# --- a result that cannot be read
# -------------------------------------------------------------------------------------


def message_of(folder):
    with pytest.raises(InputError) as caught:
        load_reconstruction(folder)
    message = str(caught.value)
    assert str(folder) in message
    assert len(message) < 700
    return message


@pytest.fixture(scope="module")
def saved(make, tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved")
    save_reconstruction(make(people=2), folder, "numbers")
    return folder


@pytest.fixture
def folder(saved, tmp_path):
    for path in saved.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def test_a_document_of_another_program_makes_no_folder_a_result(tmp_path, reconstruction):
    document = tmp_path / "reconstruction.json"
    for content in (b"[]", b"{}", b'{"schema": "other"}', b'{"cameras": []}', b"\xff"):
        document.write_bytes(content)
        assert not is_result(tmp_path)
    document.unlink()
    save_reconstruction(reconstruction, tmp_path, "numbers")
    assert is_result(tmp_path)


def test_a_folder_without_a_result(tmp_path):
    assert "there is no such file" in message_of(tmp_path)
    for content in (b"[]", b"{}", b'{"schema": "other"}', b'{"schema": '):
        (tmp_path / "reconstruction.json").write_bytes(content)
        message_of(tmp_path)


FX = '"fx": 128.0'
CX = '"cx": 79.5'


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [
        ('"schema_version": 9', '"schema_version": 8', "version"),
        ('"score": 0.875', '"score": [1]', "people.0.score"),
        (FX, '"fx": NaN', "NaN"),
        (FX, '"fx": -128.0', "fx -128"),
        (FX, '"fx": 1e300', "fx and fy"),
        (CX, '"cx": "NaN"', "finite"),
        ('"kind": "floor"', '"kind": "flor"', "flor"),
        (FX, '"fx": ' + 900 * "[" + 900 * "]", "nested"),
        (FX, '"fx": ' + 100_000 * "[", "nested"),
        (FX, '"fx": ' + 5000 * "1", "too large"),
        (f"{FX},", "", "fx"),
        ('"height": 120', '"height": 121', "image"),
        pytest.param('"run": "', '"run": "x', "another run", id="run"),
    ],
)
def test_a_document_with_invalid_values_is_refused(folder, before, after, word):
    path = folder / "reconstruction.json"
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    assert word in message_of(folder)


def test_an_edited_document_is_read(folder):
    path = folder / "reconstruction.json"
    path.write_bytes(path.read_bytes().replace(b'"offset": 1.4', b'"offset": 1.5'))
    assert load_reconstruction(folder).scene.floor.offset == 1.5


def change_arrays(folder, change, *, restated=True):
    path = folder / "reconstruction.npz"
    with np.load(path) as file:
        arrays = dict(file)
    change(arrays)
    before = digest_of(path.read_bytes())
    np.savez_compressed(path, **arrays)
    if restated:
        document = folder / "reconstruction.json"
        document.write_text(document.read_text().replace(before, digest_of(path.read_bytes())))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda a: a.pop("faces"), "faces"),
        (lambda a: a["faces"].__setitem__((0, 0), 10_000), "faces has 0 to 10000"),
        (lambda a: a["people.0.contact_partner"].__setitem__(0, 9), "people.0.contact_partner has"),
        (lambda a: a.update({"people.1.contact": a["people.0.contact"][:5]}), "people.1.contact"),
        (lambda a: a.update({"people.0.mask": a["people.0.mask"].astype(np.uint8)}), "uint8"),
        (lambda a: a.update({"people.0.vertices": a["people.0.vertices"].astype(">f4")}), "byte order"),  # noqa: E501
        (lambda a: a.update(image=a["image"][None]), "image"),
        (lambda a: a["scene.floor.normal"].fill(0), "scene.floor.normal"),
    ],
)  # fmt: skip
def test_invalid_or_missing_arrays_are_refused(folder, change, word):
    change_arrays(folder, change)
    assert word in message_of(folder)


def double(arrays):
    arrays["people.0.vertices"] *= 2


@pytest.mark.parametrize("read", [load_reconstruction, load_people, read_image])
def test_arrays_that_were_changed_after_the_run_are_refused(folder, read):
    change_arrays(folder, double)
    read(folder)
    change_arrays(folder, double, restated=False)
    with pytest.raises(
        InputError, match=r"reconstruction\.npz: its SHA-256 is not the one that .*changed"
    ):
        read(folder)


def test_a_pickle_in_the_arrays_is_not_opened(folder):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    change_arrays(folder, lambda arrays: arrays.update(faces=np.array([Bomb()], dtype=object)))
    assert "Python objects" in message_of(folder)


def test_a_small_file_cannot_fill_the_memory(folder, monkeypatch):
    monkeypatch.setattr(results, "_SMALL", 1 << 20)
    zeros = np.zeros((1_500_000, 3), np.float32)
    change_arrays(folder, lambda arrays: arrays.update({"scene.floor_points": zeros}))
    assert "its arrays need" in message_of(folder)  # imports stay in memory
    tracemalloc.start()
    try:
        message_of(folder)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("name", ["reconstruction.json", "reconstruction.npz"])
def test_a_pipe_in_place_of_a_file_is_refused(folder, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    assert "not a regular file" in message_of(folder)
