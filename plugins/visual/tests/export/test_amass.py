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
from physic_core.conversion import convert_bodies
from physic_core.errors import InputError
from physic_core.types import Bodies


@pytest.fixture(scope="module")
def converted(result, file):
    """The first person as a body of the file, as a run with [body_model] path gives it."""
    model = load_body(file)
    bodies = Bodies(result.people[0].parameters, "embedded")
    parameters = convert_bodies(bodies, model).bodies.parameters
    vertices, joints = (values[0] for values in posed(model.to(dtype=torch.float64), parameters))
    faces = model.faces.numpy().astype(np.int32)
    person = replace(
        result.people[0],
        parameters=parameters,
        vertices=vertices,
        joints=joints,
        contact=np.zeros(len(vertices), bool),
        contact_partner=np.full(len(vertices), -1, np.int16),
        faces=faces,
    )
    config = {"body_model": {"path": str(file)}}
    return replace(result, people=(person,), faces=faces, body_model="smplx", config=config)


@pytest.fixture(scope="module")
def read(file):
    """A function that gives vertices and joints of the body in a file, by smplfitter."""
    from smplfitter.pt import BodyModel

    np.save(file.parent / "kid_template.npy", np.zeros((10475, 3)))  # smplfitter wants one
    peer = BodyModel("smplx", "female", model_root=str(file.parent), num_betas=20)

    def body(path):
        with np.load(path) as arrays:
            shape = np.concatenate([arrays["betas"], arrays["expression"][0]])
            inputs = (arrays["poses"][:1], shape[None], arrays["trans"][:1])
        poses, betas, trans = (torch.from_numpy(values).float() for values in inputs)
        posed = peer(pose_rotvecs=poses, shape_betas=betas, trans=trans)
        return posed["vertices"][0].numpy(), posed["joints"][0].numpy()

    return body


@pytest.mark.parametrize("up", ["z", "camera"])
def test_smplfitter_poses_the_same_body_from_the_file(converted, read, tmp_path, up, in_frame):
    (path,) = converted.export(str(tmp_path / "a.npz"), "amass", up=up).files
    vertices, joints = read(path)
    np.testing.assert_allclose(vertices, in_frame(converted.people[0].vertices, up), atol=1e-5)
    with np.load(path) as arrays:
        np.testing.assert_array_equal(arrays["poses"][0], arrays["poses"][1])
        np.testing.assert_allclose(arrays["pelvis"] + arrays["trans"][0], joints[0], atol=1e-5)
        assert float(arrays["fit_error_m"]) == 0


def test_embedded_bodies_are_fitted_and_the_error_is_stated(result, file, read, tmp_path, in_frame):
    done = result.export(str(tmp_path / "a.npz"), "amass", body_model=file, person=1)
    vertices, joints = read(done.files[0])
    with np.load(done.files[0]) as arrays:
        error = float(arrays["fit_error_m"])
        assert str(arrays["gender"]) == "female"
        assert str(arrays["surface_model_type"]) == "smplx"
        assert arrays["poses"].shape == (2, 165)
        assert arrays["trans"].shape == (2, 3)
        assert arrays["betas"].shape == (10,)
        contact = arrays["contact"]
        assert (contact.shape, contact.dtype) == ((10475,), np.dtype(bool))
        assert float(arrays["mocap_frame_rate"]) == 30
    assert 0 < error < 0.01
    assert f"within {1000 * error:.0f} mm" in done.notes[0]
    assert "gender female" in done.notes[1]
    distance, nearest = cKDTree(in_frame(result.people[1].vertices)).query(vertices)
    assert np.median(distance) < 0.012
    near = result.people[1].contact[nearest]
    assert near.any()
    assert (contact == near).mean() > 0.95
    assert (contact & near).sum() > 0.7 * near.sum()
    assert np.abs(joints[0] - in_frame(result.people[1].joints[0])).max() < 0.06


def test_without_a_file_the_message_says_what_is_needed_and_why(result, tmp_path):
    with pytest.raises(InputError, match=r"^AMASS files hold SMPL-X"):
        result.export(str(tmp_path / "a.npz"), "amass")


def test_another_file_than_that_of_the_run_is_refused(converted, other, tmp_path):
    arrays = smplx_file_arrays(other)
    taller = tmp_path / "SMPLX_MALE.npz"
    np.savez(taller, **(arrays | {"v_template": 1.1 * arrays["v_template"]}))
    with pytest.raises(InputError, match=r"vertices \d+ mm from"):
        converted.export(str(tmp_path / "a.npz"), "amass", body_model=taller)


def test_the_skeleton_of_smplx_bodies_is_in_their_file(converted, tmp_path):
    done = converted.export(str(tmp_path / "a.glb"), scene=False)
    assert set(trimesh.load_scene(done.files[0]).geometry) == {"person_0"}
    lost = replace(converted, config={})
    with pytest.raises(InputError, match="need your SMPL-X file"):
        lost.export(str(tmp_path / "b.glb"))
