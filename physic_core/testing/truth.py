"""What is true of a staged world: bodies in the camera's frame, pictures, and what the camera sees of each point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physic_core.testing.casting import Caster, Hits
from physic_core.testing.rendering import Mesh, View, photograph, view
from physic_core.testing.rooms import MATERIALS, colours
from physic_core.testing.staging import Stage, pose_vertices
from physic_core.types import BodyParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, FloatArray, Intrinsics, UInt8Array

__all__ = ["BodiesTruth", "Pictures", "place_bodies", "project", "seen_by_camera", "take_pictures"]

_SENSOR_NOISE = 1.5  # grey levels
_SKIN = ((0.80, 0.58, 0.46), (0.55, 0.36, 0.25), (0.90, 0.70, 0.58))
_CLOTHES = ((0.16, 0.28, 0.52), (0.62, 0.18, 0.16), (0.15, 0.42, 0.30), (0.70, 0.56, 0.18), (0.28, 0.28, 0.32))


@dataclass(frozen=True)
class BodiesTruth:
    """N people in the camera's frame, metres.

    Attributes:
        parameters: SMPL-X-named.
        vertices: (N, V, 3) float64.
        joints: (N, 55, 3) float64.
        landmarks: joint set -> (N, J, 3) float64.
    """

    parameters: BodyParameters
    vertices: FloatArray
    joints: FloatArray
    landmarks: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Pictures:
    """What the camera sees, with and without the people; attributes as of ``worlds.World``."""

    image: UInt8Array
    empty_image: UInt8Array
    seen: View
    empty: View
    masks: BoolArray
    whole_masks: BoolArray
    floor_mask: BoolArray
    empty_floor_mask: BoolArray
    mesh: Mesh
    caster: Caster


def place_bodies(model: BodyModel, stage: Stage, skeletons: tuple[str, ...]) -> BodiesTruth:
    """The stage's people as float32 parameters in the camera's frame, and the bodies that exactly these pose."""
    import torch
    from scipy.spatial.transform import Rotation

    from physic_core.body.model import BodyOutput

    turn = Rotation.from_matrix(stage.camera.rotation)
    poses, transl = [], []
    for actor in stage.actors:
        pose = actor.pose.copy()
        pose[0] = (turn * Rotation.from_rotvec(pose[0])).as_rotvec()
        # The root turns about the pelvis, so the pelvis goes where the camera sees it, whatever the turn.
        _, joints = pose_vertices(model, actor.pose, actor.betas, actor.transl)
        rest_pelvis = joints[0] - actor.transl
        poses.append(pose.astype(np.float32))
        transl.append((stage.camera.to_camera(joints[0]) - rest_pelvis).astype(np.float32))
    rows = np.stack(poses)
    betas = np.stack([actor.betas for actor in stage.actors]).astype(np.float32)
    posed = [pose_vertices(model, *row) for row in zip(rows, betas, transl, strict=True)]
    vertices, joints = (np.stack(part) for part in zip(*posed, strict=True))
    output = BodyOutput(torch.as_tensor(vertices), torch.as_tensor(joints), torch.zeros(len(rows), 55, 3, 3))
    flat = rows.reshape(len(rows), -1)
    parameters = BodyParameters(
        global_orient=flat[:, 0:3],
        body_pose=flat[:, 3:66],
        jaw_pose=flat[:, 66:69],
        leye_pose=flat[:, 69:72],
        reye_pose=flat[:, 72:75],
        left_hand_pose=flat[:, 75:120],
        right_hand_pose=flat[:, 120:165],
        betas=betas,
        expression=np.zeros((len(rows), model.num_expression), np.float32),
        transl=np.stack(transl),
    )
    landmarks = {name: model.landmarks(output, name).numpy() for name in skeletons}
    return BodiesTruth(parameters, vertices, joints, landmarks)


def take_pictures(
    model: BodyModel, stage: Stage, intrinsics: Intrinsics, vertices: FloatArray, rng: np.random.Generator
) -> Pictures:
    """Cast all rays.

    Args:
        model: whose faces and parts the people have.
        stage: room and camera.
        intrinsics: the camera's.
        vertices: (N, V, 3) camera frame.
        rng: draws clothes, lamp and sensor noise.
    """
    room_vertices, room_faces, material = stage.room.mesh()
    scene = _scene_mesh(stage.camera.to_camera(room_vertices), room_faces)
    everything = _with_people(scene, model, vertices)
    clothes = np.concatenate([_dress(model, rng) for _ in vertices])

    def albedo(mesh: Mesh, hits: Hits, points: FloatArray) -> FloatArray:
        face = np.maximum(hits.face, 0)
        person = (hits.face >= 0) & (mesh.thing[face] >= 0)
        colour = np.zeros((len(points), 3))
        colour[~person] = colours(stage.room, stage.camera.to_room(points[~person]), material[face[~person]])
        corner = mesh.faces[face[person], 0] - len(scene.vertices)
        colour[person] = clothes[corner]
        return colour

    room = stage.room
    middle = np.array([rng.uniform(-0.8, 0.8), room.high[1] - 0.3, rng.uniform(0.8, 1.6)])
    lamp = stage.camera.to_camera(middle)
    noise = rng.normal(0, _SENSOR_NOISE, (intrinsics.height, intrinsics.width, 3))
    views, images, casters = [], [], []
    for mesh in (everything, scene):
        caster = Caster(mesh.vertices, mesh.faces)
        views.append(view(mesh, caster, intrinsics))
        images.append(photograph(mesh, caster, intrinsics, lamp, partial(albedo, mesh), noise))
        casters.append(caster)
    seen, empty = views
    owner = _things(everything, seen)
    people = range(len(vertices))
    alone = [
        _with_people(_scene_mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), model, vertices[i : i + 1])
        for i in people
    ]
    whole = [view(mesh, Caster(mesh.vertices, mesh.faces), intrinsics).face >= 0 for mesh in alone]
    floor = MATERIALS.index("floor")

    def floor_of(seen: View) -> BoolArray:
        on_scene = (seen.face >= 0) & (seen.face < len(material))
        on_floor: BoolArray = on_scene & (material[np.where(on_scene, seen.face, 0)] == floor)
        return on_floor

    return Pictures(
        image=images[0],
        empty_image=images[1],
        seen=seen,
        empty=empty,
        masks=np.stack([owner == i for i in people]),
        whole_masks=np.stack(whole),
        floor_mask=floor_of(seen),
        empty_floor_mask=floor_of(empty),
        mesh=everything,
        caster=casters[0],
    )


def seen_by_camera(
    model: BodyModel,
    points: FloatArray,
    names: Sequence[str],
    pictures: Pictures,
    vertices: FloatArray,
    intrinsics: Intrinsics,
) -> BoolArray:
    """Whether the photo shows each landmark.

    It does where the landmark lies in the image and nothing is in front of it but the skin that covers it, or its own
    limb: a sitter's hip behind their thigh counts as seen, a hand behind the back does not.

    Args:
        model: whose parts the people have.
        points: (N, J, 3) camera frame.
        names: of the J landmarks.
        pictures: whose mesh is cast at.
        vertices: (N, V, 3) of the people, for how deep under the skin a landmark lies.
        intrinsics: the camera's.

    Returns:
        (N, J) bool.
    """
    from scipy.spatial import KDTree

    uv = project(points, intrinsics)
    size = np.array([intrinsics.width, intrinsics.height])
    visible = (points[..., 2] > 0) & (uv > -0.5).all(axis=-1) & (uv < size - 0.5).all(axis=-1)
    limb_of_part = np.array([_LIMB_OF_PART.get(name, "") for name in model.part_names])
    limb = np.array([_limb_of_landmark(name) for name in names])
    first_person = len(pictures.mesh.vertices) - vertices.shape[0] * vertices.shape[1]
    for i, person in enumerate(points):
        depth, _ = KDTree(vertices[i]).query(person)
        hits = pictures.caster.first(np.zeros(3), person)
        face = np.maximum(hits.face, 0)
        in_front = (1 - np.minimum(hits.distance, 1)) * np.linalg.norm(person, axis=1)
        own = pictures.mesh.thing[face] == i
        corner = np.where(own, pictures.mesh.faces[face, 0] - first_person - i * vertices.shape[1], 0)
        own_limb = (limb != "") & (limb_of_part[model.part_of_vertex.numpy()[corner]] == limb)
        # Half as deep again: the nearest vertex is rarely the one towards the camera.
        visible[i] &= (in_front < 0.01) | (own & (own_limb | (in_front < 1.5 * depth + 0.03)))
    return visible


_LIMB_OF_PART = {"torso": "trunk"} | {
    f"{side}_{part}": f"{side}_{limb}"
    for side in ("left", "right")
    for limb, parts in (("leg", ("upper_leg", "lower_leg", "foot")), ("arm", ("upper_arm", "lower_arm", "hand")))
    for part in parts
}
_LEG_POINTS = ("hip", "knee", "ankle", "foot", "heel", "big_toe", "small_toe", "foot_tip")
_TRUNK_POINTS = ("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar")


def _limb_of_landmark(name: str) -> str:
    if name in _TRUNK_POINTS:
        return "trunk"
    side, _, point = name.partition("_")
    if point in _LEG_POINTS:
        return f"{side}_leg"
    return f"{side}_arm" if point in ("shoulder", "elbow", "wrist") else ""


def project(points: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Points (..., 3) camera frame -> (..., 2) px."""
    focal, centre = np.array([intrinsics.fx, intrinsics.fy]), np.array([intrinsics.cx, intrinsics.cy])
    uv: FloatArray = points[..., :2] / points[..., 2:] * focal + centre
    return uv


def _scene_mesh(vertices: FloatArray, faces: NDArray[np.int64]) -> Mesh:
    return Mesh(vertices, faces, np.full(len(faces), -1), np.zeros_like(vertices))


def _with_people(scene: Mesh, model: BodyModel, vertices: FloatArray) -> Mesh:
    import torch

    from physic_core.geometry.visibility import vertex_normals

    people, count, _ = vertices.shape
    faces = model.faces.numpy()
    offsets = len(scene.vertices) + count * np.arange(people)
    smooth = vertex_normals(torch.as_tensor(vertices), model.faces).numpy()
    return Mesh(
        vertices=np.concatenate([scene.vertices, vertices.reshape(-1, 3)]),
        faces=np.concatenate([scene.faces, *(faces + offset for offset in offsets)]),
        thing=np.concatenate([scene.thing, np.repeat(np.arange(people), len(faces))]),
        smooth=np.concatenate([scene.smooth, smooth.reshape(-1, 3)]),
    )


def _things(mesh: Mesh, seen: View) -> NDArray[np.int64]:
    return np.where(seen.face >= 0, mesh.thing[np.maximum(seen.face, 0)], -1)


def _dress(model: BodyModel, rng: np.random.Generator) -> FloatArray:
    """Colours (V, 3) of one person: skin, hair, shirt, trousers, shoes."""
    skin = np.array(_SKIN[rng.integers(len(_SKIN))])
    shirt, trousers = (np.array(_CLOTHES[i]) for i in rng.choice(len(_CLOTHES), 2, replace=False))
    rotations, betas, transl = model.zero_pose()
    output = model(rotations, betas, transl)
    rest, head = output.vertices[0].numpy(), output.joints[0, 15].numpy()
    eyes = output.joints[0, 23:25].numpy().mean(axis=0)
    colour_of = dict.fromkeys(model.part_names, skin)
    colour_of |= dict.fromkeys(("torso", "left_upper_arm", "right_upper_arm"), shirt)
    colour_of |= dict.fromkeys(
        (f"{s}_{part}" for s in ("left", "right") for part in ("upper_leg", "lower_leg")), trousers
    )
    colour_of |= dict.fromkeys(("left_foot", "right_foot"), np.array([0.12, 0.11, 0.11]))
    part = model.part_of_vertex.numpy()
    colours_of_parts = np.stack([colour_of[name] for name in model.part_names])
    colour: FloatArray = colours_of_parts[part]
    is_head = part == model.part_names.index("head")
    hips = output.joints[0, 1:3, 1].numpy().mean()
    colour[(part == model.part_names.index("torso")) & (rest[:, 1] < hips + 0.06)] = trousers
    top = (rest[:, 1] > eyes[1] + 0.045) | ((rest[:, 2] < head[2] - 0.01) & (rest[:, 1] > eyes[1] - 0.06))
    colour[is_head & top] = rng.uniform(0.05, 0.3) * np.array([1.0, 0.75, 0.55])
    return colour
