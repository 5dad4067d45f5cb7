"""The embedded asset: its mesh, its parts and contact sets, its shapes."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import physic_core.body.files as embedded_module
from physic_core.body.files import load_embedded
from physic_core.body.joints import PART_NAMES
from physic_core.body.landmarks import CONTACT_SETS
from physic_core.errors import BodyModelError

FOLDER = Path(embedded_module.__file__).parent


@pytest.fixture(scope="module")
def rest(embedded):
    """Vertices of the mean body in its T-pose."""
    return embedded(*embedded.zero_pose()).vertices[0].numpy()


def test_a_changed_asset_is_refused(tmp_path, monkeypatch):
    data = (FOLDER / "embedded.npz").read_bytes() + b"x"
    (tmp_path / "embedded.npz").write_bytes(data)
    (tmp_path / "embedded.sha256").write_text((FOLDER / "embedded.sha256").read_text())
    monkeypatch.setattr(embedded_module, "files", lambda _: tmp_path)
    with pytest.raises(BodyModelError, match=hashlib.sha256(data).hexdigest()):
        load_embedded()


def test_the_mesh_is_a_closed_ball(embedded, rest):
    mesh = trimesh.Trimesh(rest, embedded.faces.numpy(), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert 0.05 < mesh.volume < 0.08  # m3; positive: faces look outwards


def test_weights_are_a_partition_of_unity(embedded):
    weights = embedded.skin.weights
    assert weights.min() >= 0
    assert torch.allclose(weights.sum(0), torch.ones(embedded.num_vertices), atol=1e-6)
    assert int((weights > 0).sum(0).max()) <= 4


def test_every_vertex_has_a_part(embedded, rest):
    part = embedded.part_of_vertex.numpy()
    assert embedded.part_names == PART_NAMES
    assert np.bincount(part, minlength=len(PART_NAMES)).min() > 200
    middle = {name: rest[part == i].mean(0) for i, name in enumerate(PART_NAMES)}
    for limb in ("upper_arm", "lower_arm", "hand", "upper_leg", "lower_leg", "foot"):
        assert middle[f"left_{limb}"][0] > 0 > middle[f"right_{limb}"][0]
    downward = ("head", "torso", "left_upper_leg", "left_lower_leg", "left_foot")
    outward = ("torso", "left_upper_arm", "left_lower_arm", "left_hand")
    for names, axis, sign in ((downward, 1, -1), (outward, 0, 1)):
        places = [sign * middle[name][axis] for name in names]
        assert places == sorted(places)


def test_contact_sets_lie_where_they_should(embedded, rest):
    sets = {name: ids.numpy() for name, ids in embedded.contact_sets.items()}
    assert set(sets) == set(CONTACT_SETS)
    ground = rest[:, 1].min()
    normals = trimesh.Trimesh(rest, embedded.faces.numpy(), process=False).vertex_normals
    for side, sign in (("left", 1), ("right", -1)):
        sole = sets[f"{side}_sole"]
        assert rest[sole, 1].max() < ground + 0.025
        assert 0.2 < np.ptp(rest[sole, 2]) < 0.3
        assert np.isin(sole, sets[f"{side}_foot"]).all()
        for name in ("sole", "foot", "hand"):
            assert (sign * rest[sets[f"{side}_{name}"], 0] > 0).all()
        assert normals[sets[f"{side}_hand"], 1].mean() < -0.5
    for name in ("thighs", "gluteus", "back"):
        assert normals[sets[name], 2].max() < -0.2
    levels = [rest[sets[name], 1].mean() for name in ("thighs", "gluteus", "back")]
    assert levels == sorted(levels)
    assert all(embedded.outer.numpy()[ids].all() for ids in sets.values())


def test_stature_spans_children_and_adults(embedded, rest):
    betas = torch.zeros(5, 16)
    betas[:, 0] = torch.tensor([-3.0, -2.0, 0.0, 0.5, 1.5])
    stature = embedded.stature(betas)
    assert float(stature[2]) == pytest.approx(float(np.ptp(rest[:, 1])), abs=1e-6)
    assert float(stature[2]) == pytest.approx(1.69, abs=0.02)  # the mean adult
    assert (stature.diff() > 0).all()
    assert stature[0] < 1.2
    assert stature[4] > 1.9


def test_stature_is_exact_for_any_shape_and_differentiable(embedded):
    torch.manual_seed(0)
    betas = torch.randn(4, 16, requires_grad=True)
    rotations, _, transl = embedded.zero_pose(4)
    height = embedded(rotations, betas, transl).vertices[..., 1]
    stature = embedded.stature(betas)
    assert torch.allclose(stature, height.amax(1) - height.amin(1), atol=1e-6)
    (gradient,) = torch.autograd.grad(stature.sum(), betas)
    assert (gradient[:, 0] > 0.1).all()
