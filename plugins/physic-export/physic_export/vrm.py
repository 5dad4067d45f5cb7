"""VRM 1.0: each person as an avatar in a T-pose, and the pose of the photo as a VRM animation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from physic_core import ExportedFiles, ExportRequest
from physic_core.visual.glb import Look, add_joints, build_glb, glb_notes
from physic_core.visual.glb_builder import GlbBuilder
from physic_core.visual.rig import rigs
from physic_export.bone_names import bone_names
from physic_export.glb import add_animation, body_look
from physic_export.skins import Skins, skins_of
from physic_export.t_pose import skinned, t_pose

if TYPE_CHECKING:
    from physic_core.visual.rig import Rig

LICENSE_URL = "https://vrm.dev/licenses/1.0/"
"""The only licence document that VRM 1.0 accepts; what it permits are the fields of ``meta``, by default the least."""

_POSE_S = 1.0
"""Duration of the animation, through which the pose is held, seconds."""


def export_vrm(request: ExportRequest) -> ExportedFiles:
    """Return a ``.vrm`` file and a ``.vrma`` file per person.

    The avatar stands at the origin in a T-pose and faces +z, as VRM demands; metres, y up. The animation has the pose
    of the photo, turned and moved in the same way, with the height over the floor. Without a floor, the lowest point
    of the pose is at height 0.

    Raises:
        InputError: the skeleton of the bodies is not known.
    """
    colors, names = skins_of(request), bone_names("vrm")
    files: dict[str, bytes] = {}
    posed = {index: replace(rig, names=names) for index, rig in rigs(request)}
    for index, rig in posed.items():
        standing = t_pose(rig, request.frame.up_vector)
        resting = _moved(standing, standing, None)
        height = None if request.result.scene.floor is None else float(rig.offsets[0, 1])
        files[request.file_of(index)] = _avatar(colors, index, resting)
        files[f"{request.file_of(index)}a"] = _animation(resting, _moved(rig, standing, height))
    terms = f"author and permissions of a .vrm are 'unknown' and the least that {LICENSE_URL} allows: state your own"
    return ExportedFiles(files, (*colors.notes, *glb_notes(request, posed), terms))


def _moved(rig: Rig, standing: Rig, height: float | None) -> Rig:
    """Return a rig turned about the vertical and moved as its T-pose is, if that goes to the origin and faces +z.

    Args:
        rig: in any pose, y up.
        standing: the same person in the T-pose.
        height: of the pelvis, metres; None to put the lowest point at 0.
    """
    rotations, offsets = rig.rotations.copy(), rig.offsets.copy()
    rotations[0] = standing.rotations[0].T @ rotations[0]
    offsets[0] = standing.rotations[0].T @ (rig.offsets[0] - standing.offsets[0])
    placed = replace(rig, rotations=rotations, offsets=offsets)
    offsets[0, 1] = offsets[0, 1] - skinned(placed)[:, 1].min() if height is None else height
    return placed


def _avatar(colors: Skins, index: int, standing: Rig) -> bytes:
    request = replace(colors.request, people=(index,))

    def look(glb: GlbBuilder, person: int, _: ExportRequest) -> Look:
        return body_look(glb, person, colors)

    glb = build_glb(request, None, {index: standing}, look=look, camera=False)
    (scene,), (skin,) = glb.tree["scenes"], glb.tree["skins"]
    scene["extras"] = {"contact": scene["extras"]["contact"], "contact_colors": scene["extras"]["contact_colors"]}
    meta = {"name": f"person {index}", "authors": ["unknown"], "licenseUrl": LICENSE_URL}
    _add_humanoid(glb, "VRMC_vrm", skin["joints"], standing.names, {"meta": meta})
    return glb.content()


def _animation(standing: Rig, posed: Rig) -> bytes:
    glb = GlbBuilder(generator="PhySIC")
    top, joints = add_joints(glb, "skeleton", standing)
    glb.tree |= {"scenes": [{"nodes": [top]}], "scene": 0}
    add_animation(glb, (0.0, _POSE_S), [(joints, (posed, posed))])
    _add_humanoid(glb, "VRMC_vrm_animation", joints, standing.names, {})
    return glb.content()


def _add_humanoid(
    glb: GlbBuilder, extension: str, joints: list[int], names: tuple[str, ...], further: dict[str, Any]
) -> None:
    """Add an extension of VRM that states which node is which bone."""
    bones = {name: {"node": node} for name, node in zip(names, joints, strict=True)}
    if extension == "VRMC_vrm_animation":  # which forbids the eyes: they look at a target
        bones = {name: node for name, node in bones.items() if not name.endswith("Eye")}
    glb.tree["extensionsUsed"] = sorted({*glb.tree.get("extensionsUsed", ()), extension})
    entry = {"specVersion": "1.0", **further, "humanoid": {"humanBones": bones}}
    glb.tree["extensions"] = {**glb.tree.get("extensions", {}), extension: entry}
