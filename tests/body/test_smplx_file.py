"""A user's SMPL-X file: agreement with two independent packages, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.files import load_smplx
from physic_core.body.landmarks import CONTACT_SETS
from physic_core.errors import BodyModelError
from physic_core.geometry.rotvecs import rotvec_to_rotmat


@pytest.fixture
def small(smplx_arrays):
    """A file's arrays whose large ones compress to nothing."""
    flat = {
        "posedirs": np.zeros((10475, 3, 486), np.float16),
        "shapedirs": np.zeros((10475, 3, 20), np.float16),
    }
    return {**smplx_arrays, **flat}


def refusal(path, **options):
    with pytest.raises(BodyModelError) as caught:
        load_smplx(path, **options)
    return str(caught.value).removeprefix(str(path))


@pytest.fixture
def pose():
    draws = torch.randn(2, 188, generator=torch.Generator().manual_seed(1))
    rotvecs, betas, expression, transl = draws.split([165, 10, 10, 3], 1)
    rotvecs = 0.5 * rotvecs.view(2, 55, 3)
    return {"rotvecs": rotvecs, "betas": betas, "expression": expression, "transl": transl}


def pose_by(path, pose):
    rotations = rotvec_to_rotmat(pose["rotvecs"])
    return load_body(path)(rotations, pose["betas"], pose["transl"], pose["expression"])


def test_a_smplx_file_poses_as_the_library_body_models(smplx_v11, pose):
    from body_models.smplx.torch import SMPLX

    peer = SMPLX(model_path=smplx_v11, flat_hand_mean=True)
    body, head, left, right = pose["rotvecs"][:, 1:].split([21, 3, 15, 15], dim=1)
    arguments = {
        "body_pose": body,
        "head_pose": head,
        "hand_pose": torch.cat([left, right], 1),
        "pelvis_rotation": pose["rotvecs"][:, 0],
        "shape": pose["betas"],
        "expression": pose["expression"],
        "global_translation": pose["transl"],
    }
    ours = pose_by(smplx_v11, pose)
    assert (ours.vertices - peer.forward_vertices(**arguments)).abs().max() < 1e-5
    assert (ours.joints - peer.forward_skeleton(**arguments)[..., :3, 3]).abs().max() < 1e-5


def test_both_layouts_are_the_same_body(smplx_v10, smplx_v11, pose):
    old, new = (pose_by(path, pose) for path in (smplx_v10, smplx_v11))
    assert torch.equal(old.vertices, new.vertices)


def test_more_shape_components_can_be_loaded(smplx_v11):
    model = load_smplx(smplx_v11, num_betas=16, num_expression=0)
    assert (model.num_betas, model.num_expression) == (16, 0)
    assert model(*model.zero_pose()).vertices.shape == (1, 10475, 3)


def test_picks_are_derived_from_the_file(smplx_v10):
    model = load_body(smplx_v10)
    output = model(*model.zero_pose())
    points = dict(
        zip(("nose", "left_eye", "right_eye"), model.landmarks(output, "coco17")[0], strict=False)
    )
    assert points["left_eye"][0] > 0 > points["right_eye"][0]
    assert set(model.contact_sets) == set(CONTACT_SETS)
    sole = output.vertices[0, model.contact_sets["left_sole"], 1]
    assert sole.max() < output.vertices[0, :, 1].min() + 0.03
    assert model.name == model.topology == "smplx"
    assert float(model.stature(torch.zeros(1, 10))) == pytest.approx(
        float(output.vertices[0, :, 1].max() - output.vertices[0, :, 1].min()), abs=1e-6
    )


def test_a_smplx_file_is_read_without_unpickling(small, tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("the file was unpickled",))

    path = tmp_path / "SMPLX_NEUTRAL.npz"
    np.savez_compressed(path, **{**small, "part2num": np.array(Trap(), dtype=object)})
    load_body(path)
    np.savez_compressed(path, **{**small, "J_regressor": np.array(Trap(), dtype=object)})
    assert "holds a pickled object" in refusal(path)


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("v_template", (5023, 3), " is a FLAME file (5023 vertices), not SMPL-X"),
        ("shapedirs", (10475, 3), "must be (10475, 3, 20 or 400), got (10475, 3)"),
        ("shapedirs", (10475, 3, 11), "has 11 columns, where SMPL-X has 20 or 400"),
    ],
)
def test_arrays_of_wrong_shape_are_refused(tmp_path, small, name, shape, message):
    path = tmp_path / "model.npz"
    np.savez_compressed(path, **{**small, name: np.zeros(shape)})
    assert message in refusal(path)


def test_more_shape_components_than_the_file_has_are_refused(smplx_v10):
    assert "num_betas is 16, but the file has 10" in refusal(smplx_v10, num_betas=16)
