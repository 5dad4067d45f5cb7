"""Ground truth of a scene and its camera: bodies in the camera frame, images, and visibility of
landmarks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.rays import RayCaster, RayHits
from physic_core.types import SURFACE_NAMES, BodyParameters
from physic_testing.worlds.clothes import Clothes
from physic_testing.worlds.posing import pose_body
from physic_testing.worlds.rendering import (
    AreaLight,
    Lighting,
    RenderedView,
    WorldMesh,
    exposure_gain,
    pixel_rays,
    render_shaded,
    render_view,
    to_srgb,
)
from physic_testing.worlds.reproducible_math import apply, norm
from physic_testing.worlds.rooms import SurfaceColours
from physic_testing.worlds.scene_setup import StagedScene
from physic_testing.worlds.solids import yaw_matrix
from physic_testing.worlds.textures import sky

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Skeleton, UInt8Array

__all__ = [
    "Pictures",
    "WorldBodies",
    "pose_world_bodies",
    "project",
    "render_pictures",
    "visible_landmarks",
]

_SENSOR_NOISE = 1.5  # grey levels
_OVERCAST = 0.75  # light of the brightest sky


@dataclass(frozen=True)
class WorldBodies:
    """N bodies in the camera frame, m.

    Attributes:
        parameters: SMPL-X parameters.
        vertices: (N, V, 3) float64.
        joints: (N, 55, 3) float64.
        landmarks: skeleton name -> (N, J, 3) float64.
    """

    parameters: BodyParameters
    vertices: FloatArray
    joints: FloatArray
    landmarks: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Pictures:
    """Images, masks and renderings with and without people; the attributes are those of
    ``worlds.World``.
    """

    image: UInt8Array
    empty_image: UInt8Array
    seen: RenderedView
    empty: RenderedView
    masks: BoolArray
    unoccluded_masks: BoolArray
    floor_mask: BoolArray
    empty_floor_mask: BoolArray
    surfaces: UInt8Array
    empty_surfaces: UInt8Array
    item_masks: BoolArray
    mesh: WorldMesh
    caster: RayCaster


@dataclass(frozen=True)
class _RoomMesh:
    """Result of ``Room.mesh``."""

    vertices: FloatArray
    faces: NDArray[np.int64]
    surface: NDArray[np.int64]


@dataclass(frozen=True)
class _Shown:
    """A scene with or without people, as the camera sees it."""

    mesh: WorldMesh
    room: _RoomMesh
    caster: RayCaster
    view: RenderedView


def _surface_ids(room: _RoomMesh, seen: RenderedView) -> NDArray[np.int64]:
    """Return the surface (H, W) of the room that each pixel shows, numbered as in ``Room.mesh``; -1
    for none.
    """
    in_room = (seen.face >= 0) & (seen.face < len(room.faces))
    return np.where(in_room, room.surface[np.where(in_room, seen.face, 0)], -1)


def pose_world_bodies(
    model: BodyModel, stage: StagedScene, skeletons: tuple[Skeleton, ...]
) -> WorldBodies:
    """Return the bodies in the camera frame, posed with the float32 parameters that the world
    stores.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(stage.camera.rotation)
    poses = []
    transl = []
    for actor in stage.actors:
        pose = actor.pose.copy()
        pose[0] = (turn * Rotation.from_rotvec(pose[0])).as_rotvec()
        # The root turns about the pelvis, so the pelvis goes where the camera sees it, whatever the
        # turn.
        _, joints = pose_body(model, actor.pose, actor.betas, actor.transl)
        rest_pelvis = joints[0] - actor.transl
        poses.append(pose.astype(np.float32))
        transl.append((stage.camera.to_camera(joints[0]) - rest_pelvis).astype(np.float32))
    rows = np.stack(poses)
    betas = np.stack([actor.betas for actor in stage.actors]).astype(np.float32)
    posed = [pose_body(model, *row) for row in zip(rows, betas, transl, strict=True)]
    vertices, joints = (np.stack(part) for part in zip(*posed, strict=True))
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
    landmarks = {
        skeleton.name: _landmarks(model, vertices, joints, skeleton) for skeleton in skeletons
    }
    return WorldBodies(parameters, vertices, joints, landmarks)


def _landmarks(
    model: BodyModel, vertices: FloatArray, joints: FloatArray, skeleton: Skeleton
) -> FloatArray:
    """Return the landmarks (N, J, 3) of a skeleton, with a fixed order of summation."""
    regressor = model.regressor(skeleton)
    ends = np.concatenate([joints, vertices[:, regressor.vertex_ids.numpy()]], axis=1)
    points: FloatArray = (regressor.matrix.numpy()[:, :, None] * ends[:, None]).sum(axis=2)
    return points


def render_pictures(
    model: BodyModel,
    stage: StagedScene,
    vertices: FloatArray,
    rng: np.random.Generator,
    images: tuple[UInt8Array, UInt8Array] | None = None,
) -> Pictures:
    """Render the photo with and without people, with their masks.

    Args:
        model: body model of the people.
        stage: people, place and camera.
        vertices: (N, V, 3) of the people, camera frame.
        rng: random generator of clothes, lamps, sky and sensor noise.
        images: the photos with and without people, if they are known.
    """
    intrinsics = stage.intrinsics
    shell, occupied = (
        _RoomMesh(*stage.room.mesh(occupied=with_people)) for with_people in (False, True)
    )
    scene, furnished = (
        _scene_mesh(stage.camera.to_camera(part.vertices), part.faces) for part in (shell, occupied)
    )
    everything = _with_people(furnished, model, vertices)
    shown = [
        _Shown(
            mesh,
            room,
            caster := RayCaster(mesh.vertices, mesh.faces),
            render_view(mesh, caster, intrinsics),
        )
        for mesh, room in ((everything, occupied), (scene, shell))
    ]
    image, empty_image = images or _shaded(model, stage, vertices, rng, shown)
    seen, empty = (part.view for part in shown)
    owner = _person_ids(everything, seen)

    def labels_of(surface: NDArray[np.int64], seen: RenderedView) -> UInt8Array:
        names = np.array(
            [SURFACE_NAMES.index(name) for name in stage.room.surface_names()], np.uint8
        )
        number = np.where(surface >= 6, (surface - 6) // 6 + 6, surface)
        nothing = np.where(
            seen.face >= 0, SURFACE_NAMES.index("person"), SURFACE_NAMES.index("sky")
        )
        return np.where(surface >= 0, names[np.maximum(number, 0)], nothing).astype(np.uint8)

    surface = _surface_ids(occupied, seen)
    empty_surface = _surface_ids(shell, empty)
    of_item = [
        np.isin(
            (surface - 6) // 6,
            [i for i, block in enumerate(stage.room.blocks) if block.item == item],
        )
        for item in stage.room.items
    ]

    return Pictures(
        image=image,
        empty_image=empty_image,
        seen=seen,
        empty=empty,
        masks=np.stack([owner == i for i in range(len(vertices))]),
        unoccluded_masks=np.stack(
            [_silhouette(person, model.faces.numpy(), intrinsics) for person in vertices]
        ),
        floor_mask=surface == 0,
        empty_floor_mask=empty_surface == 0,
        surfaces=labels_of(surface, seen),
        empty_surfaces=labels_of(empty_surface, empty),
        item_masks=np.array(of_item, bool).reshape(-1, *surface.shape),
        mesh=everything,
        caster=shown[0].caster,
    )


def _shaded(
    model: BodyModel,
    stage: StagedScene,
    vertices: FloatArray,
    rng: np.random.Generator,
    shown: Sequence[_Shown],
) -> list[UInt8Array]:
    """Return the photos (H, W, 3) of the scene with and without people, with the exposure of the
    first.
    """
    intrinsics = stage.intrinsics
    surfaces = SurfaceColours(stage.room)
    clothes = [Clothes(model, rng) for _ in vertices]
    sky_seed = int(rng.integers(1 << 30))
    per_person = len(model.faces)
    lighting = _lighting(stage, vertices, rng)
    noise = rng.normal(0, _SENSOR_NOISE, (intrinsics.height, intrinsics.width, 3))

    def albedo(room: _RoomMesh) -> Callable[[RayHits, FloatArray, FloatArray], FloatArray]:
        def colours(hits: RayHits, points: FloatArray, blur: FloatArray) -> FloatArray:
            colour = np.zeros((len(points), 3))
            person = np.maximum(hits.face - len(room.faces), -1) // per_person  # -1 the scene
            here = person < 0
            on_room = room.surface[hits.face[here]]
            colour[here] = surfaces.albedo(stage.camera.to_room(points[here]), on_room, blur[here])
            for i, worn in enumerate(clothes):
                here = person == i
                face = hits.face[here] - len(room.faces) - i * per_person
                colour[here] = worn.albedo(face, hits.corners[here], blur[here])
            return colour

        return colours

    def overhead(rays: FloatArray) -> FloatArray:
        x, y, z = (apply(stage.camera.rotation.T, rays) / norm(rays)[:, None]).T
        # The picture's own brightness is not yet set: the sky is as light as a white wall in the
        # sun.
        light = _OVERCAST * sky(
            np.arcsin(np.clip(y, -1, 1)), np.arctan2(x, z), np.random.default_rng(sky_seed)
        )
        return light

    lights = [
        render_shaded(
            part.mesh, part.caster, intrinsics, part.view, lighting, albedo(part.room), overhead
        )
        for part in shown
    ]
    gain = exposure_gain(lights[0])
    return [to_srgb(light, gain, noise) for light in lights]


def _silhouette(
    vertices: FloatArray, faces: NDArray[np.int64], intrinsics: Intrinsics
) -> BoolArray:
    """Return the mask (H, W) of one person without occluders."""
    mask = np.zeros((intrinsics.height, intrinsics.width), bool)
    front = vertices[vertices[:, 2] > 1e-2]
    uv = project(front, intrinsics)
    x0, y0 = np.maximum(np.floor(uv.min(axis=0)).astype(int), 0)
    x1, y1 = np.ceil(uv.max(axis=0)).astype(int) + 1
    window = np.zeros(mask.shape, bool)
    window[y0 : max(y1, 0), x0 : max(x1, 0)] = True
    rays = pixel_rays(intrinsics)[window.reshape(-1)]
    mask[window] = RayCaster(vertices, faces).first_faces(np.zeros(3), rays) >= 0
    return mask


def _lighting(stage: StagedScene, vertices: FloatArray, rng: np.random.Generator) -> Lighting:
    """Draw two ceiling lamps and ambient light, or sun and sky."""
    people = stage.camera.to_room(vertices).reshape(-1, 3)
    middle = people.mean(axis=0)
    walls = stage.room.walls
    if walls is None:
        # Rather from behind the first camera than into it.
        back = np.arctan2(*(stage.first_camera.position - middle)[[0, 2]]) + rng.uniform(-2.0, 2.0)
        high = np.radians(rng.uniform(25, 65))
        sun = 200 * np.array(
            [np.sin(back) * np.cos(high), np.sin(high), np.cos(back) * np.cos(high)]
        )
        warm = np.array([1.0, rng.uniform(0.90, 1.0), rng.uniform(0.78, 0.98)])
        power = rng.choice([0.25, 0.6, 0.9])  # clouds, haze, sun
        radius = 2.0 if power > 0.5 else 60.0
        lamp = AreaLight(
            stage.camera.to_camera(middle + sun), radius, float(power), warm, distant=True
        )
        return Lighting((lamp,), ambient=0.45, fill=0.08)
    lamps = []
    low = np.array(walls.low) + 0.5
    high = np.array(walls.high) - 0.5
    for power in (1.5, 1.0):
        x, _, z = walls.to_local(middle) + rng.uniform(-1.6, 1.6, 3)
        local = np.array(
            [np.clip(x, low[0], high[0]), walls.height - 0.25, np.clip(z, low[1], high[1])]
        )
        position = stage.camera.to_camera(apply(yaw_matrix(walls.yaw), local))
        warm = np.array([1.0, rng.uniform(0.88, 1.0), rng.uniform(0.76, 1.0)])
        lamps.append(AreaLight(position, 0.25, power * float(rng.uniform(0.7, 1.3)), warm))
    return Lighting(tuple(lamps), ambient=float(rng.uniform(0.30, 0.42)), fill=0.10)


def visible_landmarks(
    model: BodyModel,
    points: FloatArray,
    names: Sequence[str],
    pictures: Pictures,
    vertices: FloatArray,
    intrinsics: Intrinsics,
) -> BoolArray:
    """Return whether each landmark is visible in the photo.

    A landmark is visible if it lies in the image and is hidden only by the skin above it or by its
    own limb: the hip of a sitting person behind the thigh is visible, a hand behind the back is
    not.

    Args:
        model: body model of the people.
        points: (N, J, 3) camera frame.
        names: names of the J landmarks.
        pictures: rendered images with their mesh.
        vertices: (N, V, 3) of the people; they give the depth of a landmark under the skin.
        intrinsics: camera intrinsics.

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
        in_front = (1 - np.minimum(hits.distance, 1)) * norm(person)
        own = pictures.mesh.thing[face] == i
        corner = np.where(
            own, pictures.mesh.faces[face, 0] - first_person - i * vertices.shape[1], 0
        )
        own_limb = (limb != "") & (limb_of_part[model.part_of_vertex.numpy()[corner]] == limb)
        # Half as deep again: the nearest vertex is rarely the one towards the camera.
        visible[i] &= (in_front < 0.01) | (own & (own_limb | (in_front < 1.5 * depth + 0.03)))
    return visible


_LIMB_OF_PART = {"torso": "trunk"} | {
    f"{side}_{part}": f"{side}_{limb}"
    for side in ("left", "right")
    for limb, parts in (
        ("leg", ("upper_leg", "lower_leg", "foot")),
        ("arm", ("upper_arm", "lower_arm", "hand")),
    )
    for part in parts
}
_LEG_POINTS = ("hip", "knee", "ankle", "foot", "heel", "big_toe", "small_toe", "foot_tip")
_TRUNK_POINTS = ("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar")


def _limb_of_landmark(name: str) -> str:
    """Return the limb of a landmark; empty for the head."""
    if name in _TRUNK_POINTS:
        return "trunk"
    side, _, point = name.partition("_")
    if point in _LEG_POINTS:
        return f"{side}_leg"
    return f"{side}_arm" if point in ("shoulder", "elbow", "wrist") else ""


def project(points: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Project points (..., 3) in the camera frame to pixels (..., 2)."""
    focal = np.array([intrinsics.fx, intrinsics.fy])
    centre = np.array([intrinsics.cx, intrinsics.cy])
    uv: FloatArray = points[..., :2] / points[..., 2:] * focal + centre
    return uv


def _scene_mesh(vertices: FloatArray, faces: NDArray[np.int64]) -> WorldMesh:
    """Return the mesh of the scene, flat shaded."""
    return WorldMesh(vertices, faces, np.full(len(faces), -1), np.zeros_like(vertices))


def _with_people(scene: WorldMesh, model: BodyModel, vertices: FloatArray) -> WorldMesh:
    """Append the people to the scene mesh."""
    people, count, _ = vertices.shape
    faces = model.faces.numpy()
    offsets = len(scene.vertices) + count * np.arange(people)
    smooth = [vertex_normals(person, faces) for person in vertices]
    return WorldMesh(
        vertices=np.concatenate([scene.vertices, vertices.reshape(-1, 3)]),
        faces=np.concatenate([scene.faces, *(faces + offset for offset in offsets)]),
        thing=np.concatenate([scene.thing, np.repeat(np.arange(people), len(faces))]),
        smooth=np.concatenate([scene.smooth, *smooth]),
    )


def _person_ids(mesh: WorldMesh, seen: RenderedView) -> NDArray[np.int64]:
    """Return the index (H, W) of the person seen by each pixel, -1 for none."""
    return np.where(seen.face >= 0, mesh.thing[np.maximum(seen.face, 0)], -1)
