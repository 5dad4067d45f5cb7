"""What the camera sees of a body: by normals, by masks, and by rays against a plain ray caster."""

from __future__ import annotations

import pytest
import torch
import trimesh

from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.visibility import (
    facing_camera,
    hidden_from_camera,
    inside_image,
    inside_mask,
    self_occlusion,
)

pytestmark = pytest.mark.quick


def sphere(centre, radius=0.3, fineness=3):
    mesh = trimesh.creation.icosphere(fineness, radius)
    vertices = torch.tensor(mesh.vertices, dtype=torch.float64) + torch.tensor(
        centre, dtype=torch.float64
    )
    return vertices, torch.tensor(mesh.faces, dtype=torch.int64)


def two_spheres(front, back):
    v1, f1 = sphere(front)
    v2, f2 = sphere(back)
    part = torch.cat(
        [torch.zeros(len(v1), dtype=torch.int64), torch.ones(len(v2), dtype=torch.int64)]
    )
    return torch.cat([v1, v2]), torch.cat([f1, f2 + len(v1)]), part


def plain_hidden(vertices, faces):
    """Every ray against every triangle (Moeller-Trumbore)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    distance = vertices.norm(dim=-1)
    ray = (vertices / distance[:, None])[:, None]
    edge1 = (b - a)[None]
    edge2 = (c - a)[None]
    p = torch.linalg.cross(ray.expand(-1, len(faces), -1), edge2.expand(len(vertices), -1, -1))
    det = (edge1 * p).sum(-1)
    det = torch.where(det.abs() < 1e-12, torch.nan, det)
    s = -a[None]
    u = (s * p).sum(-1) / det
    q = torch.linalg.cross(s, edge1)
    v = (ray * q).sum(-1) / det
    t = (edge2 * q).sum(-1) / det
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < distance[:, None] - 2e-3)
    own = (faces[None] == torch.arange(len(vertices))[:, None, None]).any(-1)
    return (hit & ~own).any(-1)


def test_facing_is_measured_against_the_ray_not_the_optical_axis():
    # Seen 45 degrees off the axis: a normal along -z makes 45 degrees with the ray, one along -x as
    # well.
    vertex = torch.tensor([[2.0, 0.0, 2.0]])
    back = torch.tensor([[0.0, 0.0, -1.0]])
    side = torch.tensor([[-1.0, 0.0, 0.0]])
    for normal in (back, side):
        assert facing_camera(normal, vertex, 46.0).item()
        assert not facing_camera(normal, vertex, 44.0).item()


def test_half_a_distant_sphere_faces_the_camera():
    vertices, faces = sphere([0.3, 0.7, 100.0], fineness=4)
    share = facing_camera(vertex_normals(vertices, faces), vertices, 90.0).double().mean()
    assert share.item() == pytest.approx(0.5, abs=0.02)


def test_pixels_round_to_their_centres():
    uv = torch.tensor(
        [[-0.4, 0.0], [-0.6, 0.0], [3.4, 1.4], [3.6, 1.0], [1.0, 1.6], [float("nan"), 0.0]]
    )
    assert inside_image(uv, height=2, width=4).tolist() == [True, False, True, False, False, False]
    mask = torch.zeros(2, 4, dtype=torch.bool)
    mask[0, 0] = mask[1, 3] = True
    assert inside_mask(uv, mask).tolist() == [True, False, True, False, False, False]


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.55])
def test_rays_equal_a_plain_ray_caster(offset):
    vertices, faces, _ = two_spheres([0.013, 0.021, 2.0], [offset, 0.05, 3.0])
    hidden, face = hidden_from_camera(vertices, faces)
    want = plain_hidden(vertices, faces)
    # On the silhouette itself rounding decides.
    assert (hidden != want).double().mean() < 0.005
    assert ((face >= 0) == hidden).all()


def test_a_part_behind_another_is_occluded_from_thirty_percent_on():
    vertices, faces, part = two_spheres([0.0, 0.0, 2.0], [0.0, 0.0, 3.0])
    hidden, of_hidden_parts = self_occlusion(vertices, faces, part, parts=[0, 1])
    # Its own back is hidden, but not by another part.
    assert hidden[part == 0].any()
    assert of_hidden_parts.tolist() == (part == 1).tolist()

    for x in torch.linspace(0.0, 0.9, 10).tolist():
        vertices, faces, part = two_spheres([0.0, 0.0, 2.0], [x, 0.0, 3.0])
        hidden, of_hidden_parts = self_occlusion(vertices, faces, part, parts=[0, 1])
        face = hidden_from_camera(vertices, faces)[1]
        share = (
            (hidden & (part[faces[face.clamp(min=0), 0]] == 0))[part == 1].double().mean().item()
        )
        assert (
            of_hidden_parts[part == 1].all() == of_hidden_parts[part == 1].any() == (share >= 0.3)
        )


def test_trunk_is_never_occluded_where_only_limbs_count():
    vertices, faces, part = two_spheres([0.0, 0.0, 2.0], [0.0, 0.0, 3.0])
    assert not self_occlusion(vertices, faces, part, parts=[0])[1].any()
