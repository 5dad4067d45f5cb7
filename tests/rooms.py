"""A room seen by a pitched camera, with capsule mannequins standing in it: results without any
network, for the tests of core and plugins.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from physic_core.types import (
    BodyContact,
    BodyParameters,
    CheckResult,
    ContactPartner,
    Intrinsics,
    Lens,
    Person,
    Plane,
    Provenance,
    Reconstruction,
    Scene,
    StageRecord,
    Support,
    UnposedPerson,
)

FLOOR = ContactPartner("floor", "floor")
CAMERA_HEIGHT = 1.4
PITCH = np.deg2rad(12.0)  # the camera looks down by so much
# Rows are the camera's axes in a world of x right, y up, z forward, whose origin is on the floor
# under the camera.
CAMERA_FROM_WORLD = np.array(
    [
        [1.0, 0.0, 0.0],
        [0.0, -np.cos(PITCH), -np.sin(PITCH)],
        [0.0, -np.sin(PITCH), np.cos(PITCH)],
    ]
)
BOX = np.array([[0.5, 0.0, 2.8], [1.2, 0.45, 3.4]])
WALL_Z = 5.0
WALL_X = -2.5
RIGHT_JOINTS = {
    1: (0.1, 0.88, 0.0),
    4: (0.11, 0.48, 0.01),
    7: (0.12, 0.08, 0.0),
    10: (0.13, 0.04, 0.13),
    16: (0.18, 1.4, 0.0),
    18: (0.24, 1.12, 0.0),
    20: (0.26, 0.88, 0.04),
}
"""Joint of the left side -> place of the next joint, its like on the right side, metres."""
LIMBS = ((1, 4, 0.08), (4, 7, 0.055), (7, 10, 0.04), (16, 18, 0.05), (18, 20, 0.04))
"""Joints of a left side at both ends of a limb, and its radius, metres."""


def to_camera(world):
    return (np.asarray(world) - [0.0, CAMERA_HEIGHT, 0.0]) @ CAMERA_FROM_WORLD.T


def make_room(width, height):
    camera = Intrinsics.from_focal(0.8 * width, width, height, "given")
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    rays = np.stack([x, y, np.ones_like(x)], -1)
    world = rays @ CAMERA_FROM_WORLD
    origin = np.array([0.0, CAMERA_HEIGHT, 0.0])
    depth = np.full((height, width), np.inf)
    normals = np.zeros((height, width, 3))
    colors = np.zeros((height, width, 3))

    def to_plane(axis, place):
        return (place - origin[axis]) / world[..., axis]

    with np.errstate(divide="ignore", invalid="ignore"):
        spot = origin + to_plane(1, 0.0)[..., None] * world
        checks = (np.floor(spot[..., 0] * 2) + np.floor(spot[..., 2] * 2)) % 2
        tiles = np.where(checks[..., None] > 0, [150, 120, 90], [205, 180, 150])
        surfaces = [
            (to_plane(1, 0.0), [0, 1, 0], tiles, True),
            (to_plane(2, WALL_Z), [0, 0, -1], [120, 150, 170], True),
            (to_plane(0, WALL_X), [1, 0, 0], [170, 190, 160], True),
        ]
        for axis, side, normal, color in (
            (0, 0, [-1, 0, 0], [190, 90, 70]),
            (1, 1, [0, 1, 0], [215, 120, 95]),
            (2, 0, [0, 0, -1], [160, 70, 55]),
        ):
            distance = to_plane(axis, BOX[side, axis])
            hit = origin + distance[..., None] * world
            inside = ((hit >= BOX[0]) & (hit <= BOX[1])) | (np.arange(3) == axis)
            surfaces.append((distance, normal, color, inside.all(-1)))
        for distance, normal, color, mask in surfaces:
            hit = mask & (distance > 0) & (distance < depth)
            depth = np.where(hit, distance, depth)
            normals[hit] = normal
            colors[hit] = np.broadcast_to(color, colors.shape)[hit]
    points = np.where(np.isfinite(depth)[..., None], rays * depth[..., None], np.nan).astype(
        np.float32
    )
    up = CAMERA_FROM_WORLD @ [0.0, 1.0, 0.0]
    z, x = np.meshgrid(np.linspace(1, 5, 9), np.linspace(-2, 2, 9))
    floor = np.stack([x, np.zeros_like(x), z], -1).reshape(-1, 3)
    return camera, Scene(
        points=points,
        normals=(normals @ CAMERA_FROM_WORLD.T).astype(np.float32),
        colors=colors.astype(np.uint8),
        valid=np.isfinite(depth),
        floor=Plane(up, CAMERA_HEIGHT),
        floor_points=to_camera(floor).astype(np.float32),
        scale=1.0625,
        scale_sigma=0.07,
    )


def mannequin(x, z, turn_deg=180.0):
    """Vertices and 55 joints in the camera's frame, and faces, of a figure 1.7 m tall that stands
    on the floor.
    """

    def limb(start, end, radius):
        shape = trimesh.creation.capsule(height=1.0, radius=radius, count=[8, 8])
        length = np.linalg.norm(np.subtract(end, start))
        shape.vertices[:, 2] += length / 2 + np.sign(shape.vertices[:, 2]) * (length - 1) / 2
        turn = trimesh.geometry.align_vectors([0, 0, 1], np.subtract(end, start))
        turn[:3, 3] = start
        return shape.apply_transform(turn)

    joints = np.tile([0.0, 0.92, 0.0], (55, 1))
    for index, y in {3: 1.03, 6: 1.15, 9: 1.25, 12: 1.47, 15: 1.57}.items():
        joints[index] = [0, y, 0]
    pieces = [limb(joints[0], joints[9], 0.14), limb(joints[12], [0, 1.58, 0], 0.11)]
    for side, sign in ((0, -1.0), (1, 1.0)):  # the figure looks along +z, so its left is -x
        for index, (right, y, forward) in RIGHT_JOINTS.items():
            joints[index + side] = [sign * right, y, forward]
        pieces += [limb(joints[a + side], joints[b + side], radius) for a, b, radius in LIMBS]
    body = trimesh.util.concatenate(pieces)
    angle = np.deg2rad(turn_deg)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    place = [x, 0.0, z]
    vertices = np.asarray(body.vertices) @ turn.T + place
    # y up, z forward
    return to_camera(vertices), to_camera(joints @ turn.T + place), np.asarray(body.faces)[:, ::-1]


def make_person(x, z, camera, turn_deg=180.0):
    vertices, joints, faces = mannequin(x, z, turn_deg)
    up = CAMERA_FROM_WORLD @ [0.0, 1.0, 0.0]
    heights = vertices @ up + CAMERA_HEIGHT
    spots = joints[:23] @ camera.matrix.T
    pixels = vertices @ camera.matrix.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    mask = np.zeros((camera.height, camera.width), bool)
    x0, y0 = np.maximum(np.floor(pixels.min(0)), 0).astype(int)
    x1, y1 = np.ceil(pixels.max(0)).astype(int)
    mask[y0:y1, x0:x1] = True
    rng = np.random.default_rng(3)
    sizes = (3, 63, 45, 45, 3, 3, 3, 16, 0, 3)  # in the order of the fields
    parameters = (rng.normal(size=(1, size)).astype(np.float32) for size in sizes)
    left_foot = BodyContact("left_foot", FLOOR, 0.9, 12)
    person = Person(
        box=np.array([x0, y0, x1, y1], np.float32),
        score=0.875,
        mask=mask,
        keypoints=(spots[:, :2] / spots[:, 2:]).astype(np.float32),
        keypoint_confidence=np.linspace(0, 1, 23, dtype=np.float32),
        parameters=BodyParameters(*parameters),
        vertices=vertices.astype(np.float32),
        joints=joints.astype(np.float32),
        contact=heights < 0.02,
        distance=np.where(heights < 0.15, heights, np.inf).astype(np.float32),
        failed_checks=("stands apart from the floor",),
        unknown_checks=("lean",),
        contact_probability=np.exp(-np.abs(heights) / 0.03).astype(np.float16),
        contact_partner=np.where(heights < 0.02, 0, -1).astype(np.int16),
        contacts=(left_foot,),
        support=Support("balanced", (left_foot,), -0.03, (0.5, 0.25, 3.0)),
        world_contact={"left_foot": 0.9, "left_hand": 0.02},
    )
    return person, faces


def make_reconstruction(width=160, height=120, people=2):
    camera, scene = make_room(width, height)
    made = [
        make_person(x, z, camera, turn)
        for x, z, turn in [(-0.6, 3.0, 180.0), (0.3, 3.8, 90.0)][:people]
    ]
    backend = Provenance(
        interface="segmenter",
        backend="mock",
        plugin="physic_mock",
        distribution="metricbody-testing",
        version="0.1.0",
        options={"threshold": 0.5, "names": ["a", "b"], "limit": float("inf"), "nothing": None},
        weights_license="Apache-2.0",
    )
    return Reconstruction(
        image=scene.colors.copy(),
        intrinsics=camera,
        scene=scene,
        people=tuple(person for person, _ in made),
        faces=(made or [make_person(0, 3, camera)])[0][1].astype(np.int32),
        body_model="embedded",
        skeleton="coco23",
        stages=(StageRecord("people", 0.25, 1.5, backend), StageRecord("joint", 1 / 3)),
        diagnostics={"joint": {"contact": [12.5, 0.1], "lowest": float("-inf")}, "rounds": 2},
        warnings=("The focal length is a default – “0.95” of the long side.", "NaN"),
        notes=("read from a file",),
        contact_partners=(FLOOR, ContactPartner("person", person=1, part="left_hand")),
        config={
            "preset": "default",
            "engine": {"joint": {"steps": 100, "weight": 0.3}},
            "floor": True,
        },
    )


def tiny_result(seed=0):
    """Return a result of 16 x 12 px; another seed gives a larger picture and other numbers."""
    made = make_reconstruction(16 + seed, 12)
    return replace(
        made,
        diagnostics={"joint": {"seed": seed}},
        checks=(
            CheckResult("floor", "ok", 0.4, 0.15, "at least", "share", "of the pixels"),
            CheckResult("lean", "unknown", None, 12.0, "at most", "deg", "no floor", 0),
        ),
        photo="pixels-sha256:0",
        lens=Lens(made.intrinsics, (0.1, -0.01, 0.0, 0.0, 0.0)),
        unposed=(UnposedPerson((1.0, 1.0, 3.0, 4.0), 0.5, "no pose fits the box"),),
    )
