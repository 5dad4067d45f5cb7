"""Draw the worlds that ship with physic-testing, and write their files into ``worlds/data``.

Photos are WebP of quality 85; the photo without people is stored where it differs. Lengths are in
steps of 0.1 mm.
"""

from __future__ import annotations

import os
import sys
from dataclasses import fields
from pathlib import Path

os.environ["PHYSIC_WORLD_CACHE"] = "off"

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body import load_body
from physic_core.body.bones import rotations_from_parameters
from physic_core.types import SURFACE_NAMES, BodyParameters
from physic_testing.worlds import World, build_world

DATA = Path(__file__).parent.parent / "plugins/physic-testing/physic_testing/worlds/data"
SIZE, STEP_M, QUALITY, RIM_PX = (640, 480), 1e-4, 85, 33
PORTRAIT = ("walk_portrait",)
DRAWN: dict[str, tuple[str, int]] = {
    "stand": ("stand", 0),
    "stand_indoors": ("stand", 1),
    "walk": ("walk", 0),
    "walk_portrait": ("walk", 1),
    "sit_on_chair": ("sit_on_chair", 0),
    "sit_on_sofa": ("sit_on_sofa", 0),
    "sit_on_stool": ("sit_on_stool", 0),
    "sit_side_by_side": ("sit_side_by_side", 0),
    "squat": ("squat", 0),
    "squat_indoors": ("squat", 1),
    "kneel": ("kneel", 0),
    "lie": ("lie", 0),
    "climb_step": ("climb_step", 0),
    "lean_on_wall": ("lean_on_wall", 0),
    "hug": ("hug", 0),
    "group": ("group", 1),
    "outdoor_steps": ("outdoor_steps", 0),
    "outdoor_crowd": ("outdoor_steps", 2),
    "jump": ("jump", 0),
    "hang_from_bar": ("hang_from_bar", 0),
    "hold_ball": ("hold_ball", 0),
    "hands_on_hips": ("hands_on_hips", 0),
    "child_by_the_hand": ("child_by_the_hand", 8),
    **{f"child_by_the_hand_view{i + 1}": (f"child_by_the_hand+view{i}", 1) for i in range(2)},
    **{f"hold_hands_view{i + 1}": (f"hold_hands+view{i}", 4) for i in range(3)},
    **{f"group_view{i + 1}": (f"group+view{i}", 3) for i in range(3)},
    "sit_on_chair_other": ("sit_on_chair+other", 1),
    "walk_other": ("walk+other", 4),
    "sit_behind_table_other": ("sit_behind_table+other", 1),
    "stand_behind_counter_other": ("stand_behind_counter+other", 1),
    "climb_step_other": ("climb_step+other", 1),
    "sit_on_floor_other": ("sit_on_floor+other", 1),
    "slope_other": ("slope+other", 1),
    "lean_on_table_other": ("lean_on_table+other", 1),
    "lie_other": ("lie+other", 1),
}
"""Name of a stored world -> name and seed of the drawn one."""


def main() -> None:
    """Write the worlds that are named on the command line, or all."""
    DATA.mkdir(exist_ok=True)
    for name in sys.argv[1:] or DRAWN:
        size = SIZE[::-1] if name in PORTRAIT else SIZE
        world = build_world(*DRAWN[name], size)
        np.savez_compressed(DATA / f"{name}.npz", **arrays_of(world))
        print(name, flush=True)


def arrays_of(world: World) -> dict[str, NDArray]:
    """Return the arrays of the file of a world."""
    return {
        **{field.name: getattr(world.parameters, field.name) for field in fields(BodyParameters)},
        **pictures_of(world),
        **scene_of(world),
        **offsets_of(world),
        "intrinsics": np.array(
            [getattr(world.intrinsics, key) for key in ("fx", "fy", "cx", "cy", "width", "height")]
        ),
        "camera_rotation": world.camera.rotation,
        "camera_position": world.camera.position,
        "floor": np.array([*world.floor.normal, world.floor.offset]),
        "action": np.array(world.action),
        "items": np.array(world.items, dtype="U16"),
        "ages": world.ages,
        "joints_visible": world.joints_visible,
        **{f"visible_{skeleton}": seen for skeleton, seen in world.visible.items()},
        "contact": world.contact,
        "support": world.support,
        "touched_surface": world.touched_surface,
        "touched_own_part": world.touched_own_part.astype(np.int8),
        "touched_person": world.touched_person.astype(np.int8),
        "touched_item": world.touched_item.astype(np.int8),
        "distance_mm": np.clip(np.round(1000 * world.distance), -127, 127).astype(np.int8),
    }


def pictures_of(world: World) -> dict[str, NDArray]:
    """Return the photo, the photo without people where it differs, and where (packed bits)."""
    photo = encoded(world.image)
    shown = cv2.imdecode(photo, cv2.IMREAD_COLOR)[..., ::-1]
    differs = (world.image != world.empty_image).any(axis=2).astype(np.uint8)
    differs = cv2.morphologyEx(differs, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    near = cv2.dilate(differs, np.ones((RIM_PX, RIM_PX), np.uint8))
    beside = np.where(near[..., None] > 0, shown, 128)
    empty = np.where(differs[..., None] > 0, world.empty_image, beside).astype(np.uint8)
    return {"photo": photo, "empty_photo": encoded(empty), "changed": np.packbits(differs > 0)}


def encoded(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the WebP file of a picture (H, W, 3)."""
    written, data = cv2.imencode(".webp", picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    assert written
    return np.asarray(data, np.uint8).ravel()


def scene_of(world: World) -> dict[str, NDArray]:
    """Return the mesh of scene and small objects, and the surface and the object of each face."""
    assert not world.room.dents, "stored scenes have no dents"
    vertices, faces, side = world.room.mesh(occupied=True)
    names = world.room.surface_names()
    block = np.where(side >= 6, (side - 6) // 6, -1)
    item = np.full(len(faces), -1, np.int8)
    for number, name in enumerate(world.items):
        item[np.isin(block, [i for i, one in enumerate(world.room.blocks) if one.item == name])] = (
            number
        )
    return {
        "scene_vertices": np.round(world.camera.to_camera(vertices) / STEP_M).astype(np.int32),
        "scene_faces": faces.astype(np.uint16),
        "face_surface": np.array(
            [SURFACE_NAMES.index(names[i]) for i in np.where(block >= 0, block + 6, side)], np.uint8
        ),
        "face_item": item,
    }


def offsets_of(world: World) -> dict[str, NDArray]:
    """Return by how much vertices and joints differ from those of the body model, in steps."""
    model, parameters = load_body("embedded").to(dtype=torch.float64), world.parameters
    shape = [
        torch.from_numpy(v).double()
        for v in (parameters.betas, parameters.transl, parameters.expression)
    ]
    body = model(rotations_from_parameters(parameters, "cpu", torch.float64), *shape)
    pairs = {
        "vertex_offset": (world.vertices, body.vertices),
        "joint_offset": (world.joints, body.joints),
    }
    return {
        key: np.round((true - posed.numpy()) / STEP_M).astype(np.int16)
        for key, (true, posed) in pairs.items()
    }


if __name__ == "__main__":
    main()
