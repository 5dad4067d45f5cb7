"""Results out and back in: whole, exact, and never half."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import physic_core.io.results as results
import physic_core.io.saving as saving
from physic_core.errors import InputError, OutputError
from physic_core.files.atomic import check_writable
from physic_core.io.arrays import PERSON_ARRAYS, SHARED_ARRAYS
from physic_core.io.document import to_document
from physic_core.io.result_folder import file_digest
from physic_core.io.results import load_reconstruction
from physic_core.io.saving import save_reconstruction


def strict(text: bytes):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


# --- there and back ---------------------------------------------------------------------------------------------------


def test_small_arrays_keep_the_precision_that_their_backend_gave_them(tmp_path, reconstruction, assert_same):
    people = tuple(
        replace(
            person,
            box=person.box.astype(np.float64) + 1 / 3,
            keypoints=person.keypoints.astype(np.float64) + 1 / 3,
            keypoint_confidence=person.keypoint_confidence.astype(np.float64) / 3,
        )
        for person in reconstruction.people
    )
    floor = replace(reconstruction.scene.floor, normal=reconstruction.scene.floor.normal.astype(np.float32))
    before = replace(reconstruction, people=people, scene=replace(reconstruction.scene, floor=floor))
    save_reconstruction(before, tmp_path, "exact")
    assert_same(before, load_reconstruction(tmp_path))


@pytest.mark.parametrize("people", [0, 1, 2])
def test_load_gives_back_what_save_took(tmp_path, make, people, assert_same):
    before = make(people=people)
    save_reconstruction(before, tmp_path, "exact")
    assert_same(before, load_reconstruction(tmp_path))


def test_numbers_that_are_not_finite_survive(tmp_path, reconstruction, assert_same):
    person = replace(reconstruction.people[0], score=math.nan, vertices=reconstruction.people[0].vertices * np.nan)
    before = replace(reconstruction, people=(person, *reconstruction.people[1:]))
    save_reconstruction(before, tmp_path, "exact+preview")
    assert_same(before, load_reconstruction(tmp_path))


def test_arrays_and_numpy_numbers_become_lists_and_numbers(reconstruction):
    numbers = {"a": np.float32(0.5), "b": np.arange(3), "c": (1, 2), "d": Path("x/y"), "e": {3: np.bool_(True)}}
    document = to_document(replace(reconstruction, diagnostics=numbers), [])
    assert document["diagnostics"] == {"a": 0.5, "b": [0, 1, 2], "c": [1, 2], "d": "x/y", "e": {"3": True}}


# --- what lies in the folder ------------------------------------------------------------------------------------------


def test_the_files_of_a_result(tmp_path, reconstruction):
    paths = save_reconstruction(reconstruction, tmp_path)
    names = [
        "reconstruction.json",
        "reconstruction.npz",
        "combined.glb",
        "scene.glb",
        "person_0.glb",
        "person_1.glb",
        "preview.png",
    ]
    assert [path.name for path in paths] == names
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted(names)


def test_the_arrays_are_what_their_table_says(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    person = reconstruction.people[0]
    height, width = reconstruction.image.shape[:2]
    sizes = {"H": height, "W": width, "F": len(reconstruction.faces), "V": len(person.vertices), "P": 1}
    sizes |= {"J": len(person.keypoints), "K": 16, "E": 0, "M": len(reconstruction.scene.floor_points)}
    expected = {spec.name: spec for spec in SHARED_ARRAYS}
    expected |= {f"person_{index}_{spec.name}": spec for index in (0, 1) for spec in PERSON_ARRAYS}
    with np.load(tmp_path / "reconstruction.npz", allow_pickle=False) as arrays:
        assert set(arrays) == set(expected)
        for name, spec in expected.items():
            array = arrays[name]
            assert array.shape == tuple(sizes.get(size, size) for size in spec.shape), name
            assert array.dtype in {"text": [array.dtype], "floating": ["f4", "f8"]}.get(spec.dtype, [spec.dtype]), name
            assert array.dtype.kind != "O"
        assert str(arrays["body_model"]) == "embedded"
        np.testing.assert_array_equal(arrays["person_1_contact"], reconstruction.people[1].contact)


def test_the_document_states_units_frame_and_camera(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    text = (tmp_path / "reconstruction.json").read_bytes()
    document = strict(text)
    assert document["schema_version"] == 5
    assert document["units"] == {"length": "metres", "angle": "radians", "time": "seconds", "image": "pixels"}
    assert document["frame"]["axes"] == "OpenCV camera: x right, y down, z forward; origin at the camera"
    assert document["image"] == {"width": 160, "height": 120}
    assert document["intrinsics"]["fx"] == reconstruction.intrinsics.fx
    assert document["people"][0]["failed_checks"] == ["stands apart from the floor"]
    assert document["people"][0]["unknown_checks"] == ["lean"]
    assert (document["grade"], document["people"][0]["grade"]) == ("bad", "doubtful")
    assert document["people"][1]["box"] == reconstruction.people[1].box.tolist()
    assert document["scene"]["floor"]["offset"] == 1.4
    assert document["scene"]["scale"] == 1.0625
    assert document["stages"][0]["backend"]["distribution"] == "physic-mock"
    assert document["stages"][0]["backend"]["weights_license"] == "Apache-2.0"
    assert document["stages"][0]["backend"]["options"]["limit"] == "Infinity"
    assert document["stages"][1]["backend"] is None
    assert document["diagnostics"]["joint"]["contact"] == [12.5, 0.1]
    assert document["config"] == reconstruction.config
    assert document["warnings"][0] == reconstruction.warnings[0]
    assert document["notes"] == ["read from a file"]
    assert {entry["name"] for entry in document["arrays"]["shared"]} == {spec.name for spec in SHARED_ARRAYS}
    assert "–" in text.decode()  # readable, not escaped
    assert '"normal": [' in text.decode()  # rows of numbers stay on one line
    assert len(text.decode().splitlines()) < 450


# --- a folder that was used before ------------------------------------------------------------------------------------


def test_a_smaller_result_leaves_nothing_of_a_larger_one(tmp_path, make):
    save_reconstruction(make(people=2), tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "person_9.ply").write_text("mine")
    save_reconstruction(make(people=1), tmp_path, "exact+glb")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [
        "combined.glb",
        "notes.txt",
        "person_0.glb",
        "person_9.ply",
        "reconstruction.json",
        "reconstruction.npz",
        "scene.glb",
    ]


def test_files_beside_no_result_are_left_alone(tmp_path, make):
    (tmp_path / "person_7.glb").write_text("mine")
    save_reconstruction(make(people=1), tmp_path, "exact")
    assert (tmp_path / "person_7.glb").read_text() == "mine"


def test_a_failing_write_leaves_the_former_result(tmp_path, make, monkeypatch, assert_same):
    before = make(people=1)
    save_reconstruction(before, tmp_path)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(saving, "encode_document", full)
    with pytest.raises(OutputError) as caught:
        save_reconstruction(make(people=2), tmp_path)
    assert str(caught.value) == (
        f"cannot write results to {tmp_path}: No space left on device; name another folder, or free space there"
    )
    assert_same(before, load_reconstruction(tmp_path))
    assert not list(tmp_path.glob(".*"))


# --- a folder that cannot be written ----------------------------------------------------------------------------------


def test_out_may_not_be_written(tmp_path, monkeypatch):
    def refuse(self, _):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError) as caught:
        check_writable(tmp_path)
    assert str(caught.value) == (
        f"cannot write results to {tmp_path}: Permission denied; name another folder, or check who may write there"
    )


# --- a result that cannot be read -------------------------------------------------------------------------------------


def state_the_digest(folder) -> None:
    """Write the digest of the arrays into the document, as a user does who replaces them."""
    path = folder / "reconstruction.json"
    digests = {"reconstruction.npz": file_digest(folder / "reconstruction.npz")}
    path.write_text(json.dumps(json.loads(path.read_bytes()) | {"digests": digests}))


def message_of(folder) -> str:
    with pytest.raises(InputError) as caught:
        load_reconstruction(folder)
    return str(caught.value)


def test_a_folder_without_a_result(tmp_path):
    path = tmp_path / "reconstruction.json"
    assert message_of(tmp_path) == f"cannot read {path}: there is no such file; name the folder of a finished run"


def test_a_result_of_another_schema_version_is_refused(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.json"
    path.write_bytes(path.read_bytes().replace(b'"schema_version": 5', b'"schema_version": 4'))
    assert message_of(tmp_path) == (
        f"cannot read {path}: its schema version is 4, and this PhySIC reads 5; "
        "load it with the PhySIC that wrote it, or run the reconstruction again"
    )


@pytest.mark.parametrize("content", [b"[]", b"{}", b'{"schema": "other"}'])
def test_a_json_file_that_is_no_result_is_refused(tmp_path, content):
    path = tmp_path / "reconstruction.json"
    path.write_bytes(content)
    assert message_of(tmp_path) == (
        f"cannot read {path}: it does not describe a reconstruction; name the folder of a finished run"
    )


def test_a_document_that_is_not_json_is_an_error(tmp_path):
    path = tmp_path / "reconstruction.json"
    path.write_bytes(b'{"schema": ')
    assert message_of(tmp_path) == (
        f"cannot read {path}: it is not JSON (Expecting value: line 1 column 12 (char 11)); "
        "run the reconstruction again"
    )


def test_a_document_without_a_required_key_is_an_error(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.json"
    document = json.loads(path.read_bytes())
    del document["intrinsics"]
    path.write_text(json.dumps(document))
    assert message_of(tmp_path) == (f"cannot read {path}: the document has no intrinsics; run the reconstruction again")


def test_arrays_of_another_run_are_refused(tmp_path, make):
    save_reconstruction(make(people=1), tmp_path / "a", "exact")
    save_reconstruction(make(people=2), tmp_path / "b", "exact")
    path = tmp_path / "a" / "reconstruction.npz"
    path.write_bytes((tmp_path / "b" / "reconstruction.npz").read_bytes())
    assert message_of(tmp_path / "a") == (
        f"cannot read {path}: its SHA-256 differs from that in reconstruction.json beside it, so it is damaged, or "
        "from another run; run the reconstruction again"
    )


def test_missing_arrays_are_named(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    with np.load(path) as arrays:
        kept = {name: arrays[name] for name in arrays if name not in ("faces", "person_1_contact")}
    np.savez(path, **kept)
    state_the_digest(tmp_path)
    assert message_of(tmp_path) == (
        f"cannot read {path}: it has no faces, person_1_contact; run the reconstruction again"
    )


@pytest.mark.parametrize("share", [0.3, 0.999])
def test_truncated_arrays_are_refused(tmp_path, reconstruction, share):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    assert "its SHA-256 differs from that" in message_of(tmp_path)
    state_the_digest(tmp_path)
    assert message_of(tmp_path) == (
        f"cannot read {path}: it is damaged (File is not a zip file); run the reconstruction again"
    )


def test_a_flipped_bit_is_noticed(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        content[archive.getinfo("scene_points.npy").header_offset + 50_000] ^= 1
    path.write_bytes(bytes(content))
    assert "its SHA-256 differs from that" in message_of(tmp_path)
    state_the_digest(tmp_path)
    assert message_of(tmp_path) == (
        f"cannot read {path}: it is damaged (Bad CRC-32 for file 'scene_points.npy'); run the reconstruction again"
    )


def test_a_pickle_in_the_arrays_is_not_opened(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    with np.load(path) as arrays:
        kept = dict(arrays)
    kept["faces"] = np.array([{"code": "here"}], dtype=object)
    np.savez(path, **kept)
    state_the_digest(tmp_path)
    assert message_of(tmp_path).startswith(f"cannot read {path}: it is damaged (an array holds Python objects)")


def test_an_edited_document_is_read_and_replaced_as_the_runs_own(tmp_path, reconstruction, assert_same):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.json"
    path.write_bytes(path.read_bytes().replace(b'"offset": 1.4', b'"offset": 1.5'))
    assert load_reconstruction(tmp_path).scene.floor.offset == 1.5
    save_reconstruction(reconstruction, tmp_path, "exact")
    assert_same(reconstruction, load_reconstruction(tmp_path))


@pytest.mark.parametrize(
    ("before", "after", "fault"),
    [
        ('"score": 0.875', '"score": [1]', "'people.0.score' is [1], which is not of this entry's type"),
        ('"grade": "bad"', '"grade": "\x1b[31m"', "it is not JSON (Invalid control character at: line"),
        ('"width": 160', '"width": "\\u001b[31m"', r"'image.width' is '\x1b[31m', which is not of this entry's type"),
        ('"fx": 128.0', '"fx": NaN', "it is not JSON (NaN is not a JSON number)"),
        ('"fx": 128.0', '"fx": 1e999', "it is not JSON (the number 1e999 is too large)"),
        ('"fx": 128.0', '"fx": 128.0, "fx": 1', "it is not JSON (an object has the key 'fx' twice)"),
        ('"fx": 128.0', '"fx": ' + 900 * "[" + 900 * "]", "it is not JSON (values are nested more than 200 deep)"),
        ('"fx": 128.0', '"fx": ' + 100_000 * "[", "it is not JSON (values are nested more than 200 deep)"),
        ('"fx": 128.0', '"fx": ' + 5000 * "1", "it is not JSON (a number has 5000 digits)"),
        ('"body_model": "embedded"', '"body_model": "smplx"', "body_model is 'embedded', but reconstruction.json has"),
        ('"height": 120', '"height": 121', "image is uint8 (120, 160, 3), not uint8 (121, 160, 3)"),
    ],
    ids=["kind", "control", "escape", "nan", "infinite", "twice", "nested", "deep", "digits", "model", "size"],
)  # fmt: skip
def test_values_that_do_not_belong(tmp_path, reconstruction, before, after, fault):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.json"
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    message = message_of(tmp_path)
    assert fault in message
    assert message.startswith(f"cannot read {tmp_path}/reconstruction.")
    assert message.endswith("; run the reconstruction again")
    assert len(message) < 500


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda a: a["faces"].__setitem__((0, 0), 10_000), "faces has vertices 0 to 10000, but a person has {count}"),
        (lambda a: a.update(person_1_contact=a["person_0_contact"][:5]),
         "person_1_contact is bool (5,), not bool ({count},)"),
        (lambda a: a.update(person_0_mask=a["person_0_mask"].astype(np.uint8)),
         "person_0_mask is uint8 (120, 160), not bool (120, 160)"),
        (lambda a: a.update(floor_normal=np.zeros((0, 3))), "floor_normal is float64 (0, 3), not floating (1, 3)"),
        (lambda a: a.update(person_7_box=a["person_0_box"]),
         "it has arrays for 8 people, but reconstruction.json lists 2"),
        (lambda a: a.update(image=a["image"][None]), "image is uint8 (1, 120, 160, 3), not uint8 (120, 160, 3)"),
        (lambda a: a.update(scene_points=a["scene_points"].astype(">f4")),
         "scene_points is float32 (120, 160, 3) in the other byte order, not float32 (120, 160, 3)"),
    ],
    ids=["faces", "vertices", "dtype", "floor", "people", "dimensions", "byte order"],
)  # fmt: skip
def test_arrays_that_contradict_each_other(tmp_path, reconstruction, change, fault):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    with np.load(path) as file:
        arrays = dict(file)
    change(arrays)
    np.savez(path, **arrays)
    state_the_digest(tmp_path)
    # The capsules of trimesh have another number of vertices in other versions.
    fault = fault.format(count=len(reconstruction.people[0].vertices))
    assert message_of(tmp_path) == f"cannot read {path}: it is damaged ({fault}); run the reconstruction again"


def test_a_small_file_cannot_fill_the_memory(tmp_path, reconstruction, monkeypatch):
    monkeypatch.setattr(results, "_SMALL", 1 << 20)
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    with np.load(path) as file:
        arrays = dict(file)
    arrays["floor_points"] = np.zeros((1_500_000, 3), np.float32)
    np.savez_compressed(path, **arrays)
    state_the_digest(tmp_path)
    assert path.stat().st_size < 140_000
    message_of(tmp_path)  # imports and the compiled schema stay in memory
    tracemalloc.start()
    try:
        message = message_of(tmp_path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    fault = message.removeprefix(f"cannot read {path}: it is damaged (")
    assert re.fullmatch(r"its arrays claim 19 MB, more than \d\); run the reconstruction again", fault)
    assert peak < 1_000_000


def test_more_people_than_a_photo_can_show_are_refused_before_they_are_looked_at(tmp_path, reconstruction):
    save_reconstruction(reconstruction, tmp_path, "exact")
    path = tmp_path / "reconstruction.json"
    document = json.loads(path.read_bytes())
    path.write_text(json.dumps(document | {"people": [7] * 1_000_000}))
    # Not "'people.0' is 7": no item is validated.
    assert message_of(tmp_path) == (
        f"cannot read {path}: 'people' is [7, 7, 7, 7, 7, 7, ...], which is not of this entry's type; "
        "run the reconstruction again"
    )


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("name", ["reconstruction.json", "reconstruction.npz"])
def test_a_pipe_in_place_of_a_file(tmp_path, reconstruction, name):
    save_reconstruction(reconstruction, tmp_path, "exact")
    (tmp_path / name).unlink()
    os.mkfifo(tmp_path / name)
    assert message_of(tmp_path) == f"cannot read {tmp_path / name}: not a regular file; check who may read it"
