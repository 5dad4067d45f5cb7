"""SMPL-X parameters as AMASS npz, with a made-up SMPL-X file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from other_body import posed, smplx_file_arrays
from scipy.spatial import cKDTree

from physic_core.body import load_body
from physic_core.body.convert.bodies import convert_with_residuals
from physic_core.errors import InputError
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.types import Bodies


@pytest.fixture(scope="module")
def file(other, tmp_path_factory):
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_FEMALE.npz"
    np.savez(path, **smplx_file_arrays(other))
    yield path
    path.unlink()  # pytest keeps folders of old runs


@pytest.fixture(scope="module")
def model(file):
    return load_body(file)


@pytest.fixture(scope="module")
def converted(result, file, model):
    """The first person as a body of the file, as a run with [body_model] path gives it."""
    people = []
    for person in result.people[:1]:
        parameters = convert_with_residuals(
            Bodies(person.parameters, "embedded"), model
        ).bodies.parameters
        vertices, joints = alone(model, parameters)
        contact = np.zeros(len(vertices), bool)
        own = replace(
            person, parameters=parameters, vertices=vertices, joints=joints, contact=contact
        )
        people.append(replace(own, contact_partner=np.full(len(vertices), -1, np.int16)))
    faces = model.faces.numpy().astype(np.int32)
    people = [replace(person, faces=faces) for person in people]
    config = {"body_model": {"path": str(file)}}
    return replace(result, people=tuple(people), faces=faces, body_model="smplx", config=config)


def alone(model, parameters):
    """Vertices and joints of one body, by the model in float64."""
    return (values[0] for values in posed(model.to(dtype=torch.float64), parameters))


def read(model, path):
    """Vertices and joints of the body in a file, by the model in float64."""
    with np.load(path) as arrays:
        poses, trans = (torch.from_numpy(arrays[name][:1]) for name in ("poses", "trans"))
        betas, expression = (torch.from_numpy(arrays[name]) for name in ("betas", "expression"))
    turns = rotvec_to_rotmat(poses.reshape(1, 55, 3))
    out = model.to(dtype=torch.float64)(turns, betas[None], trans, expression[:1])
    return out.vertices[0].numpy(), out.joints[0].numpy()


@pytest.mark.parametrize("up", ["z", "camera"])
def test_our_model_poses_the_same_bodies_from_the_file(converted, model, tmp_path, up, in_frame):
    done = converted.export(str(tmp_path / "a.npz"), up=up)
    for path, person in zip(done.files, converted.people, strict=True):
        vertices, joints = read(model, path)
        np.testing.assert_allclose(vertices, in_frame(person.vertices, up), atol=1e-5)
        with np.load(path) as arrays:
            pelvis = arrays["pelvis"] + arrays["trans"][0]
            assert float(arrays["fit_error_m"]) == 0
        np.testing.assert_allclose(pelvis, joints[0], atol=1e-5)


def test_smplfitter_poses_the_same_body_from_the_file(converted, file, tmp_path, in_frame):
    from smplfitter.pt import BodyModel as Peer

    np.save(file.parent / "kid_template.npy", np.zeros((10475, 3)))  # smplfitter wants one
    peer = Peer("smplx", "female", model_root=str(file.parent), num_betas=20)
    with np.load(converted.export(str(tmp_path / "a.npz"), person=0).files[0]) as arrays:
        poses, trans = (torch.from_numpy(arrays[name]).float() for name in ("poses", "trans"))
        shape = torch.from_numpy(np.concatenate([arrays["betas"], arrays["expression"][0]]))[
            None
        ].float()
    assert torch.equal(poses[0], poses[1])
    theirs = peer(pose_rotvecs=poses[:1], shape_betas=shape, trans=trans[:1])["vertices"][0].numpy()
    np.testing.assert_allclose(theirs, in_frame(converted.people[0].vertices), atol=1e-5)


def test_embedded_bodies_are_fitted_and_the_error_is_stated(
    result, file, model, tmp_path, in_frame
):
    done = result.export(str(tmp_path / "a.npz"), body_model=file, person=1)
    vertices, joints = read(model, done.files[0])
    with np.load(done.files[0]) as arrays:
        error = float(arrays["fit_error_m"])
        assert str(arrays["gender"]) == "female"
        assert str(arrays["surface_model_type"]) == "smplx"
        assert arrays["poses"].shape == (2, 165)
        assert arrays["trans"].shape == (2, 3)
        assert arrays["betas"].shape == (10,)
        assert float(arrays["mocap_frame_rate"]) == 30
    assert 0 < error < 0.01
    assert f"within {1000 * error:.0f} mm" in done.notes[0]
    assert "gender female" in done.notes[1]
    distance, _ = cKDTree(in_frame(result.people[1].vertices)).query(vertices)
    assert np.median(distance) < 0.012
    assert np.abs(joints[0] - in_frame(result.people[1].joints[0])).max() < 0.06


def test_without_a_file_the_message_says_what_is_needed_and_why(result, tmp_path):
    with pytest.raises(InputError, match=r"^AMASS files hold SMPL-X"):
        result.export(str(tmp_path / "a.npz"))


def test_another_file_than_that_of_the_run_is_refused(converted, other, tmp_path):
    arrays = smplx_file_arrays(other)
    taller = tmp_path / "SMPLX_MALE.npz"
    np.savez(taller, **(arrays | {"v_template": 1.1 * arrays["v_template"]}))
    with pytest.raises(InputError, match=r"vertices \d+ mm from"):
        converted.export(str(tmp_path / "a.npz"), body_model=taller)


def test_the_skeleton_of_smplx_bodies_is_in_their_file(converted, tmp_path):
    done = converted.export(str(tmp_path / "a.glb"), scene=False)
    assert set(trimesh.load_scene(done.files[0]).geometry) == {"person_0"}
    lost = replace(converted, config={})
    with pytest.raises(InputError, match="has SMPL-X bodies"):
        lost.export(str(tmp_path / "b.glb"))
