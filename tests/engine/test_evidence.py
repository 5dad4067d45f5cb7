"""What a run holds fixed and what the photo shows: thinning, limbs, keypoints, clouds."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.precompute import subsample_vertices
from physic_core.engine.joint.snapshot import OcclusionTracker
from physic_core.engine.joint.terms.picture import DepthTerm
from physic_core.engine.limbs import keypoints_of_observed_limbs
from physic_core.geometry.mesh import vertex_areas
from physic_core.types import SKELETONS
from physic_paper.terms.chamfer import HumanPoints

from .adjusted import adjusted, part_of, shifted
from .drawn import uniform

SETTINGS = engine_preset("default").joint


def test_thinning_keeps_the_surface_and_what_may_touch(body):
    area = vertex_areas(body(*body.zero_pose(1)).vertices, body.faces)
    keep = torch.zeros(body.num_vertices, dtype=torch.bool)
    keep[body.contact_sets["gluteus"]] = True
    ids, thinned = subsample_vertices(body, keep, 0.02, area)
    assert len(ids) < 0.35 * body.num_vertices
    assert (ids[1:] > ids[:-1]).all()
    assert body.outer[ids].all()
    for name in ("gluteus", "left_sole", "right_sole"):
        assert torch.isin(body.contact_sets[name], ids).all()
    outer = area[:, body.outer].sum()
    assert_close(thinned.sum(), outer)
    for part in range(len(body.part_names)):
        rows = body.part_of_vertex[ids] == part
        whole = (body.part_of_vertex == part) & body.outer
        assert_close(thinned[:, rows].sum(), area[:, whole].sum(), rtol=1e-4, atol=0)


def test_thinning_changes_the_energy_little(standing):
    state = shifted(standing.state, 0.0, 0.04, 0.0)
    every = adjusted(SETTINGS, visibility__vertex_spacing_m=0.0)
    thin, full = (JointEnergy(state, settings)() for settings in (SETTINGS, every))
    for name in ("contact", "floor", "soles"):
        assert thin[name].item() == pytest.approx(full[name].item(), rel=0.05), name


@pytest.mark.parametrize("skeleton", ["coco17", "coco23", "blazepose33"])
def test_keypoints_go_with_their_limb(skeleton):
    observed = torch.ones(1, 55, dtype=torch.bool)
    observed[0, [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_wrist"]]] = False
    names = SKELETONS[skeleton].names
    seen = keypoints_of_observed_limbs(SKELETONS[skeleton], observed)[0]
    unseen = {name for name, s in zip(names, seen.tolist(), strict=True) if not s}
    assert {"left_ankle", "right_wrist"} <= unseen
    feet = {n for n in names if n.startswith("left_") and n.endswith(("toe", "heel", "foot_tip"))}
    assert feet <= unseen
    assert not any("knee" in n or "left_elbow" in n or "eye" in n for n in unseen)


def test_self_occlusion_is_found_again_after_a_motion_of_a_centimetre(standing):
    occlusion = OcclusionTracker(JointEnergy(standing.state, SETTINGS).sampling)
    vertices = standing.vertices
    first = occlusion(vertices)[0].clone()
    rough = vertices + 0.01 * uniform(*vertices.shape).float() - 0.005
    fresh = OcclusionTracker(JointEnergy(standing.state, SETTINGS).sampling)(rough)[0]
    assert not torch.equal(fresh, first)
    assert torch.equal(occlusion(rough)[0], first)
    assert torch.equal(occlusion(3 * vertices)[0], first)
    aside = rough + torch.tensor([0.1, 0.0, 0.0])
    assert not torch.equal(occlusion(aside)[0], first)


def test_chamfer_equals_its_slow_reference_under_a_scale(standing):
    state = standing.state
    cloud = HumanPoints.of_state(state)
    vertices = standing.vertices[:, ::7] + torch.tensor([0.01, 0.0, 0.05])
    facing = uniform(*vertices.shape[:2]) < 0.5
    log_scale = torch.tensor(0.1)
    points = cloud.points[0].double() * log_scale.exp()
    seen = vertices[0, facing[0]].double()
    pairs = torch.cdist(seen, points, compute_mode="donot_use_mm_for_euclid_dist")
    want = pairs.amin(1).square().sum() + pairs.amin(0).square().sum()
    assert cloud(vertices, facing, log_scale).item() == pytest.approx(want.item(), rel=1e-4)


def test_depth_is_read_where_the_photo_shows_the_person(standing):
    energy = JointEnergy(standing.state, SETTINGS)
    rows = energy.weights["depth"][0] > 0
    vertices = standing.vertices[0, energy.sampling.ids[rows]]
    seen = part_of(energy, DepthTerm).log_map_depth[0, rows].exp()
    assert rows.sum() > 300
    assert (vertices[:, 2] - seen).abs().median() < 0.005
