"""GLB: textured bodies with skeleton, T-pose and pose, contact as a second material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry import rotmat_to_quat
from physic_export.skeleton import at_rest, bone_names, named_rig, t_pose, with_ends
from physic_export.skins import Skins, skins_of
from physic_visual.glb import (
    Appearance,
    body_material,
    build_glb,
    glb_notes,
    photo_appearance,
)
from physic_visual.palette import BODY_RGB
from physic_visual.rig import rigs
from physic_visual.textures.dressed import dressed_bodies
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core.types import Float64Array
    from physic_visual.glb_builder import GlbBuilder
    from physic_visual.rig import Rig

_FRAME_S = 1 / 24
"""Time of frame 1, the pose; Blender's frames are 1/24 s."""


def export_glb(request: ExportRequest) -> ExportedFiles:
    """Return a GLB file.

    People are skinned meshes with texture coordinates. Their material is the photo's colours, a
    plain one, or contact (option ``skin``); the other two are variants of it
    (KHR_materials_variants). The vertex attribute ``_CONTACT`` is 1 or 0, ``_FILLED`` 1 where the
    photo does not show the body, and 0 where it does; with ``plain``, the file has neither. The
    animation ``pose`` is a T-pose at 0 s and the pose at 1/24 s; without it, the nodes are in the
    pose. With ``rest_pose``, they and the mesh are in the bind pose, for readers that take nodes
    for it. With ``contact_texture``, there is also a PNG of contact per person.

    Raises:
        InputError: the skeleton of the bodies is not known.
    """
    options = request.options
    style = str(options["names"])
    up = request.frame.up_vector
    skins = {index: named_rig(rig, style, up) for index, rig in rigs(request)}
    if style == "mixamo":
        names = tuple(f"mixamorig:{name}" for name in bone_names(style))
        skins = {index: with_ends(replace(rig, names=names)) for index, rig in skins.items()}
    colors = skins_of(request)
    stored = skins
    if options["rest_pose"]:
        stored = {index: at_rest(rig, up) for index, rig in skins.items()}

    glb = build_glb(request, stored, partial(_body_appearance, colors))
    if skins:
        joints = [skin["joints"] for skin in glb.tree["skins"]]
        keys = [
            (nodes, (t_pose(rig, up), rig))
            for nodes, rig in zip(joints, skins.values(), strict=True)
        ]
        add_animation(glb, (0.0, _FRAME_S), keys)
    if options["plain"]:
        for mesh in glb.tree["meshes"]:
            for part in mesh["primitives"]:
                for name in [one for one in part["attributes"] if one.startswith("_")]:
                    del part["attributes"][name]
    files = {f"{request.stem}{request.suffix}": glb.content()}
    if options["contact_texture"] and colors.source:
        for index in request.person:
            picture = encode_image(colors.contact_image(index), "PNG")
            files[f"{request.stem}_contact_{index}.png"] = picture
    return ExportedFiles(files, (*colors.notes, *glb_notes(request, skins)))


def _body_appearance(
    colors: Skins, glb: GlbBuilder, index: int, request: ExportRequest
) -> Appearance:
    """Return the materials of a person, as variants, and their texture coordinates."""
    mesh = colors.mesh
    if mesh is None:
        return Appearance(body_material("body", BODY_RGB))
    dressed = dressed_bodies(request.result).people[index]
    contact = encode_image(colors.contact_image(index), "PNG"), "image/png"
    photo = encode_image(colors.photo_images(index)[0], "JPEG")
    skin = str(request.options["skin"])
    look = photo_appearance(glb, f"person_{index}", photo, contact, mesh, dressed.shown_share, skin)
    return replace(
        look, attributes={**look.attributes, "_FILLED": dressed.guessed_share[mesh.vertex]}
    )


def add_animation(
    glb: GlbBuilder, seconds: Sequence[float], skeletons: Sequence[tuple[list[int], Sequence[Rig]]]
) -> None:
    """Add the animation ``pose``, from pose to pose.

    Args:
        glb: the file.
        seconds: time of each pose.
        skeletons: indices of the joints, and their pose at each time.
    """
    times = glb.add_accessor(np.array(seconds, np.float32), with_bounds=True)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []

    def add(node: int, path: str, values: Float64Array) -> None:
        output = glb.add_accessor(values.astype(np.float32))
        samplers.append({"input": times, "output": output})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

    for joints, poses in skeletons:
        quaternions = rotmat_to_quat(np.stack([pose.rotations for pose in poses]))
        positions = np.stack([pose.offsets for pose in poses], 1)
        for joint, node in enumerate(joints):
            add(node, "rotation", quaternions[:, joint])
            if not joint or np.ptp(positions[joint], axis=0).any():
                add(node, "translation", positions[joint])
    glb.add("animations", {"name": "pose", "samplers": samplers, "channels": channels})
