"""A result of several photos, out and back in: cameras, pixels and people of each photo."""

from __future__ import annotations

import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from physic_core import load_people, load_reconstruction, save_reconstruction
from physic_core.errors import InputError
from physic_core.io.result_folder import file_digest
from physic_core.io.schema_file import result_schema_file


def edited(folder, change):
    """Change the document of a result; the other checks of its content stay."""
    path = folder / "reconstruction.json"
    document = json.loads(path.read_bytes())
    change(document)
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("save", ["exact", "numbers"])
def test_load_gives_back_all_photos(tmp_path, several_photos, save, assert_same):
    save_reconstruction(several_photos, tmp_path, save)
    assert_same(several_photos.cameras, load_reconstruction(tmp_path).cameras)


def test_the_people_alone_have_their_masks_in_all_photos(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path, "people")
    arrays = load_people(tmp_path)
    np.testing.assert_array_equal(arrays["camera_2_person_1_mask"], several_photos.cameras[2].people[1].mask)
    assert not {"image", "camera_1_image", "camera_2_person_0_mask"} & set(arrays)


def test_a_camera_maps_points_of_the_reference_frame(several_photos):
    camera = several_photos.cameras[1]
    assert camera.to_camera(camera.centre) == pytest.approx(np.zeros(3), abs=1e-12)
    assert camera.pose @ [0, 0, 0, 1] == pytest.approx([*camera.centre, 1])
    joints = camera.to_camera(several_photos.people[0].joints[:23])
    pixels = joints @ camera.intrinsics.matrix.T
    assert pixels[:, :2] / pixels[:, 2:] == pytest.approx(camera.people[0].keypoints, abs=1e-3)
    assert several_photos.cameras[0].pose.tolist() == np.eye(4).tolist()


def test_only_a_result_of_several_photos_has_cameras(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path / "several", "exact")
    save_reconstruction(replace(several_photos, cameras=()), tmp_path / "one", "exact")
    several, one = (json.loads((tmp_path / name / "reconstruction.json").read_bytes()) for name in ("several", "one"))
    assert set(several) - set(one) == {"cameras"}
    assert several["cameras"][0] == {"photo": "0.jpg"}
    schema = json.loads(result_schema_file().read_text())
    for document in (several, one):
        jsonschema.validate(document, schema)
    assert set(several["cameras"][1]) == set(schema["$defs"]["camera"]["properties"])


def test_the_arrays_of_all_photos_are_listed(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path, "exact")
    listed = json.loads((tmp_path / "reconstruction.json").read_bytes())["arrays"]["shared"]
    shapes = {one["name"]: one["shape"] for one in listed if one["name"].startswith("camera_2")}
    assert shapes == {
        "camera_2_image": "H2 x W2 x 3",
        "camera_2_person_1_box": "4",
        "camera_2_person_1_mask": "H2 x W2",
        "camera_2_person_1_keypoints": "J x 2",
        "camera_2_person_1_keypoint_confidence": "J",
    }


def test_a_person_of_a_photo_is_one_of_the_result(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path, "exact")
    edited(tmp_path, lambda document: document["cameras"][2]["people"][0].update(index=7))
    message = (
        f"cannot read {tmp_path / 'reconstruction.npz'}: it is damaged (reconstruction.json lists person 7 in a photo, "
        "but has 2 people); run the reconstruction again"
    )
    with pytest.raises(InputError) as caught:
        load_reconstruction(tmp_path)
    assert str(caught.value) == message


def test_missing_arrays_of_a_photo_are_named(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path, "exact")
    path = tmp_path / "reconstruction.npz"
    with np.load(path) as arrays:
        kept = {name: arrays[name] for name in arrays if not name.startswith("camera_2_")}
    np.savez(path, **kept)
    edited(tmp_path, lambda document: document["digests"].update({path.name: file_digest(path)}))
    with pytest.raises(InputError) as caught:
        load_reconstruction(tmp_path)
    assert str(caught.value) == (
        f"cannot read {path}: it has no camera_2_image, camera_2_person_1_box, camera_2_person_1_mask, "
        "camera_2_person_1_keypoints, camera_2_person_1_keypoint_confidence; run the reconstruction again"
    )


def test_a_photo_of_another_size_is_named(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path, "exact")
    edited(tmp_path, lambda document: document["cameras"][1]["intrinsics"].update(width=121))
    with pytest.raises(InputError, match=r"camera_1_image is uint8 \(100, 120, 3\), not uint8 \(100, 121, 3\)"):
        load_reconstruction(tmp_path)


@pytest.mark.parametrize("key", ["intrinsics", "rotation", "translation", "position_sigma", "people"])
def test_a_photo_without_a_key_is_named(tmp_path, several_photos, key):
    save_reconstruction(several_photos, tmp_path, "exact")
    path = edited(tmp_path, lambda document: document["cameras"][1].pop(key))
    with pytest.raises(InputError) as caught:
        load_reconstruction(tmp_path)
    assert str(caught.value) == (
        f"cannot read {path}: an entry is missing or of the wrong type ('{key}'); run the reconstruction again"
    )


def test_a_rotation_is_three_by_three(tmp_path, several_photos):
    save_reconstruction(several_photos, tmp_path, "exact")
    path = edited(tmp_path, lambda document: document["cameras"][1]["rotation"].pop())
    with pytest.raises(InputError) as caught:
        load_reconstruction(tmp_path)
    assert str(caught.value).startswith(f"cannot read {path}: 'cameras.1.rotation' is [[")


def test_the_text_of_a_result_counts_its_photos(several_photos):
    assert repr(several_photos) == (
        "Reconstruction(2 people, 3 photos, 160 x 120, floor found, scale ±7 %, 2 warnings)"
    )
