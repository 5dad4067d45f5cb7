"""A user's SMPL file: agreement with the package that reads it too, pickles that do no harm, and
what is refused.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from other_body import smpl_file_arrays
from pickles import chumpy, pickled, select
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from physic_core.body.files import SMPL_PARENTS, load_smpl
from physic_core.errors import BodyModelError


@pytest.fixture(scope="module")
def arrays(smaller):
    rng = np.random.default_rng(0)
    return {**smpl_file_arrays(smaller), "posedirs": 1e-3 * rng.standard_normal((6890, 3, 207))}


@pytest.fixture(scope="module")
def light(arrays):
    """The same in a small file."""
    return {**arrays, "posedirs": np.zeros((6890, 3, 207), np.int8)}


@pytest.fixture(scope="module")
def npz(arrays, tmp_path_factory):
    path = tmp_path_factory.mktemp("smpl") / "SMPL_NEUTRAL.npz"
    np.savez(path, **arrays)
    np.save(path.parent / "kid_template.npy", np.zeros((6890, 3)))
    yield path
    path.unlink()


def refusal(path):
    with pytest.raises(BodyModelError) as caught:
        load_smpl(path)
    return str(caught.value).removeprefix(str(path))


def test_the_published_pickle_is_read(light, tmp_path):
    """Sparse regressor, chumpy's shape directions, a dictionary and words that nobody needs."""
    shapes = light["shapedirs"]
    whole = np.concatenate([shapes, shapes + 1], 2)
    chosen = np.arange(whole.size).reshape(whole.shape)[:, :, :10]
    published = {
        **light,
        "J_regressor": csc_matrix(light["J_regressor"]),
        "shapedirs": select(chumpy(whole), chosen.ravel(), chosen.shape),
        "v_template": chumpy(light["v_template"]),
        "pose_training_info": {"gender": "neutral"},
        "bs_type": "lrotmin",
    }
    found = load_smpl(pickled(tmp_path / "SMPL.pkl", published))
    names = ("v_template", "f", "shapedirs", "posedirs", "J_regressor", "weights")
    *values, parents = vars(found).values()
    assert parents == SMPL_PARENTS
    for name, array in zip(names, values, strict=True):
        assert_array_equal(array, light[name])


def test_a_smpl_file_poses_as_in_smplfitter(npz, arrays):
    import torch
    from smplfitter.pt import BodyModel as Peer

    rng = np.random.default_rng(1)
    rotvecs = 0.5 * rng.standard_normal((3, 24, 3))
    betas = rng.standard_normal((3, 10))
    transl = rng.random((3, 3))
    published = {**arrays, "J_regressor": csc_matrix(arrays["J_regressor"])}
    pickled(npz.parent / "basicmodel_neutral_lbs_10_207_0_v1.1.0.pkl", published)
    peer = Peer("smpl", "neutral", model_root=str(npz.parent), num_betas=10)
    given = {"pose_rotvecs": rotvecs.reshape(3, 72), "shape_betas": betas, "trans": transl}
    theirs = peer(**{name: torch.from_numpy(value).float() for name, value in given.items()})
    rotations = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(3, 24, 3, 3)
    own = load_smpl(npz)
    assert_allclose(own.vertices(rotations, betas, transl), theirs["vertices"], atol=2e-6)
    assert_allclose(own.smpl_joints(rotations, betas, transl), theirs["joints"], atol=2e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"v_template": np.zeros((10475, 3))}, " is a SMPL-X file (10475 vertices), not SMPL"),
        ({"weights": np.zeros((6890, 52))}, " is a SMPL+H file (52 joints), not SMPL"),
        (
            {"shapedirs": np.zeros((6890, 3))},
            ": shapedirs must be (6890, 3, 10 to 300), got (6890, 3)",
        ),
        ({"J_regressor": "none", "weights": None}, " lacks the arrays J_regressor, weights"),
    ],
)
def test_files_of_other_models_are_refused(change, words, light, tmp_path):
    assert refusal(pickled(tmp_path / "SMPL.pkl", {**light, **change})).startswith(f"{words}: ")
