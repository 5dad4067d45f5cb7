"""Synthetic problems of the joint optimisation (stage 3) for speed measurements.

The number of people and the resolution are free. The scene is a room with a floor, a wall and a seat for every second
person. People stand or sit, four per row. The evidence is the truth with noise of a realistic size, so that the
optimisation takes as long as on a photo.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel
from physic_core.engine.joint.problem import JointProblem
from physic_core.geometry.camera import pixel_grid, project, unproject
from physic_core.geometry.raster import rasterize
from physic_core.geometry.rotations import rotvec_to_rotmat
from physic_testing.worlds.skeletons import BLAZEPOSE

SKELETON = BLAZEPOSE

_CAMERA_HEIGHT = 1.4  # metres over the floor, looking level
_WALL_M = 7.5
_ROW = 4  # people side by side
_SPACING = 0.9  # metres
_FIRST_ROW, _ROW_DEPTH = 3.6, 1.5  # metres

_POSE_NOISE = 0.08  # radians
_PLACE_NOISE = (0.02, 0.02, 0.12)  # metres
_PIXEL_NOISE = 0.004  # of the image's height
_DEPTH_NOISE = 0.02  # of a smooth warp of the depth

_STANDING = {"left_shoulder": (0.0, 0.0, -1.2), "right_shoulder": (0.0, 0.0, 1.2)}
_SITTING = {
    **_STANDING,
    "left_hip": (-1.5, 0.0, 0.1),
    "right_hip": (-1.5, 0.0, -0.1),
    "left_knee": (1.5, 0.0, 0.0),
    "right_knee": (1.5, 0.0, 0.0),
}


def make_joint_problem(
    model: BodyModel, people: int = 1, size: tuple[int, int] = (640, 480), seed: int = 0
) -> JointProblem:
    """Build a problem of the joint optimisation (stage 3): people in a room, initialised near the truth.

    Args:
        model: embedded or SMPL-X body model, on the CPU.
        people: 1 to 8, so that all are in the image.
        size: width and height, px.
        seed: seed of shapes, noise and small pose differences.
    """
    width, height = size
    g = torch.Generator().manual_seed(seed)
    focal = 0.9 * width
    K = torch.tensor([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    rotations, betas, transl, seats = _stand_and_sit(model, people, g)
    posed = model(rotations, betas, transl)
    scene, normals = _room(K, height, width, seats)
    masks, depth = _render_masks_and_depth(posed.vertices, model, K, height, width, scene)

    keypoints = project(model.landmarks(posed, SKELETON), K)
    keypoints = keypoints + _PIXEL_NOISE * height * torch.randn(keypoints.shape, generator=g)
    noise = _POSE_NOISE * torch.randn(people, 55, 3, generator=g)
    place = torch.tensor(_PLACE_NOISE) * torch.randn(people, 3, generator=g)
    v, u = torch.meshgrid(torch.linspace(0, math.pi, height), torch.linspace(0, math.pi, width), indexing="ij")
    warp = 1 + _DEPTH_NOISE * torch.sin(u + v)
    rows = scene[..., 2] > 0
    return JointProblem(
        model=model,
        rotations0=rotations @ rotvec_to_rotmat(noise),
        betas0=betas + 0.3 * torch.randn(betas.shape, generator=g),
        expression0=torch.zeros(people, model.num_expression),
        transl0=transl + place,
        keypoints=keypoints,
        keypoint_confidence=torch.ones(keypoints.shape[:2]),
        skeleton=SKELETON,
        K=K,
        masks=masks,
        scene_points=(scene * warp[..., None])[rows],
        scene_normals=normals[rows],
        contact_probability=_contact_probability(model, people),
        observed=torch.ones(people, 55, dtype=torch.bool),
        scene_depth=torch.where(rows, scene[..., 2] * warp, torch.nan),
        floor_normal=torch.tensor([0.0, -1.0, 0.0]),
        floor_offset=_CAMERA_HEIGHT * 1.03,
        human_depth=depth * warp,
    )


def _stand_and_sit(model: BodyModel, people: int, g: torch.Generator) -> tuple[Tensor, Tensor, Tensor, list[Tensor]]:
    """Return rotations, betas, translations, and a seat (2, 3) of low and high corners for each sitting person."""
    turns = 0.05 * torch.randn(people, 55, 3, generator=g)
    for i in range(people):
        for name, turn in (_SITTING if i % 2 else _STANDING).items():
            turns[i, JOINT_INDEX[name]] += torch.tensor(turn)
    turns[:, 0] = 0.0
    rotations = rotvec_to_rotmat(turns)
    rotations[:, 0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))  # facing the camera, head up
    betas = 0.7 * torch.randn(people, model.num_betas, generator=g)
    transl = torch.zeros(people, 3)
    for i in range(people):
        row, column = divmod(i, _ROW)
        in_row = min(_ROW, people - row * _ROW)
        transl[i, 0] = (column - (in_row - 1) / 2) * _SPACING + 0.3 * row
        transl[i, 2] = _FIRST_ROW + row * _ROW_DEPTH
    vertices = model(rotations, betas, transl).vertices
    transl[:, 1] = _CAMERA_HEIGHT - vertices[..., 1].amax(1)
    below = torch.cat([model.contact_sets["gluteus"], model.contact_sets["thighs"]])
    seats = []
    for i in range(1, people, 2):
        low = vertices[i, below].amin(0) + transl[i] * torch.tensor([0.0, 1.0, 0.0])
        high = vertices[i, below].amax(0) + transl[i] * torch.tensor([0.0, 1.0, 0.0])
        top = high[1].item()
        seats.append(torch.tensor([[low[0], top, low[2]], [high[0], _CAMERA_HEIGHT, high[2]]]))
    return rotations, betas, transl, seats


def _room(K: Tensor, height: int, width: int, seats: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Return points (H, W, 3) and normals of floor, wall and seats as seen without people."""
    ray = unproject(pixel_grid(height, width, K), torch.ones(height, width), K)
    wall = torch.full((height, width), _WALL_M)
    floor = torch.where(ray[..., 1] > 1e-6, _CAMERA_HEIGHT / ray[..., 1].clamp(min=1e-6), torch.inf)
    depth = torch.minimum(wall, floor)
    normals = torch.where(
        (floor < wall)[..., None], torch.tensor([0.0, -1.0, 0.0]), torch.tensor([0.0, 0.0, -1.0])
    ).clone()
    for low, high in seats:
        safe = torch.where(ray.abs() < 1e-9, torch.full_like(ray, 1e-9), ray)
        one, other = low / safe, high / safe
        enter, leave = torch.minimum(one, other), torch.maximum(one, other)
        near, axis = enter.max(-1)
        hit = (near < leave.amin(-1)) & (near > 0) & (near < depth)
        depth = torch.where(hit, near, depth)
        faces = -torch.nn.functional.one_hot(axis, 3) * ray.gather(-1, axis[..., None]).sign()
        normals = torch.where(hit[..., None], faces, normals)
    return ray * depth[..., None], normals


def _render_masks_and_depth(
    vertices: Tensor, model: BodyModel, K: Tensor, height: int, width: int, scene: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the visible masks (B, H, W) of the people and the depth (H, W) of the photo."""
    uv = project(vertices, K)
    faces = rasterize(uv, vertices[..., 2], model.faces, height, width)
    people = torch.arange(len(vertices))[:, None, None]
    z = vertices[..., 2][people[..., None], model.faces[faces.clamp(min=0)]].mean(-1)
    z = torch.where(faces >= 0, z, torch.inf)
    nearest, owner = z.min(0)
    front = nearest < scene[..., 2]
    return (owner == people) & front, torch.where(front, nearest, scene[..., 2])


def _contact_probability(model: BodyModel, people: int) -> Tensor:
    """Return contact probabilities (B, V): soles for all, seat and thighs for sitting people."""
    probability = torch.zeros(people, model.num_vertices)
    for i in range(people):
        for name in ("left_sole", "right_sole", *(("gluteus", "thighs") if i % 2 else ())):
            probability[i, model.contact_sets[name]] = 0.9
    return probability
