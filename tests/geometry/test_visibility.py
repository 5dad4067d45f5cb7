"""What the camera sees of a body: by normals, by masks, and by rays."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from physic_core.geometry.rays import RayCaster
from physic_core.geometry.visibility import (
    facing_camera,
    front_depth,
    hidden_from_camera,
    in_free_space,
    inside_image,
    inside_mask,
    self_occlusion,
)

pytestmark = pytest.mark.quick


def sphere(centre):
    mesh = trimesh.creation.icosphere(3, 0.3)
    return torch.tensor(mesh.vertices + centre), torch.tensor(mesh.faces)


def two_spheres(front, back):
    v1, f1 = sphere(front)
    v2, f2 = sphere(back)
    return (
        torch.cat([v1, v2]),
        torch.cat([f1, f2 + len(v1)]),
        torch.arange(2).repeat_interleave(len(v1)),
    )


def test_facing_is_measured_against_the_ray_not_the_optical_axis():
    # Seen 45 degrees off the axis: a normal along -z makes 45 degrees with the ray, one along -x as
    # well.
    vertex = torch.tensor([[2.0, 0.0, 2.0]])
    back = torch.tensor([[0.0, 0.0, -1.0]])
    side = torch.tensor([[-1.0, 0.0, 0.0]])
    normals = torch.cat([back, side])
    assert facing_camera(normals, vertex, 46.0).all()
    assert not facing_camera(normals, vertex, 44.0).any()


def test_pixels_round_to_their_centres():
    uv = torch.tensor(
        [[-0.4, 0.0], [-0.6, 0.0], [3.4, 1.4], [3.6, 1.0], [1.0, 1.6], [float("nan"), 0.0]]
    )
    assert inside_image(uv, height=2, width=4).tolist() == [True, False, True, False, False, False]
    mask = torch.zeros(2, 4, dtype=torch.bool)
    mask[0, 0] = mask[1, 3] = True
    assert inside_mask(uv, mask).tolist() == [True, False, True, False, False, False]


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.55])
def test_hidden_vertices_have_a_face_of_any_side_before_them(offset):
    vertices, faces, _ = two_spheres([0.013, 0.021, 2.0], [offset, 0.05, 3.0])
    hidden, face = hidden_from_camera(vertices, faces)
    distance = vertices.norm(dim=-1)
    plain = RayCaster(vertices, faces, "numpy").first(np.zeros(3), vertices / distance[:, None])
    want = torch.from_numpy(plain.distance) < distance - 2e-3
    # On the silhouette itself rounding decides.
    assert (hidden != want).double().mean() < 0.005
    assert ((face >= 0) == hidden).all()


def test_a_part_behind_another_is_occluded_from_thirty_percent_on():
    for x in torch.linspace(0.0, 0.9, 10).tolist():
        vertices, faces, part = two_spheres([0.0, 0.0, 2.0], [x, 0.0, 3.0])
        hidden, of_hidden_parts = self_occlusion(vertices, faces, part, [0, 1], 0.3)
        face = hidden_from_camera(vertices, faces)[1]
        share = (
            (hidden & (part[faces[face.clamp(min=0), 0]] == 0))[part == 1].double().mean().item()
        )
        # the back of the front one is hidden, but not by another part
        assert of_hidden_parts.tolist() == ((part == 1) & (share >= 0.3)).tolist()


def test_space_is_free_before_all_surfaces_around_a_pixel_and_where_nothing_is_known():
    K = torch.tensor([[40.0, 0.0, 15.5], [0.0, 42.0, 11.5], [0.0, 0.0, 1.0]])
    depth = torch.full((24, 32), torch.nan)
    depth[:, 16:] = 2.0
    depth[:, 17:] = 1.0
    front = front_depth(depth)
    # Between columns 14 and 15 nothing is known, the next ones are at 2 m, and then at 1 m.
    columns = torch.tensor([14.5, 15.5, 15.5, 16.5, 16.5])
    z = torch.tensor([9.0, 1.9, 2.1, 0.9, 1.1])
    points = torch.stack([(columns - 15.5) / 40 * z, torch.zeros(5), z], -1)
    assert in_free_space(points, front, K).tolist() == [True, True, False, True, False]
    outside = torch.tensor([[5.0, 0.0, 2.0], [0.0, -5.0, 2.0], [0.0, 0.0, -2.0]])
    assert in_free_space(outside, front, K).all()
