"""The formats of ``physic export``: name, suffixes, audience, frame, and the function that makes the files.

This module imports nothing heavy, so that a command can list the formats.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from physic_core.errors import InputError

__all__ = ["FORMATS", "Format", "find_format"]


@dataclass(frozen=True)
class Format:
    """One export format.

    Attributes:
        name: as in ``physic export --to NAME``.
        suffixes: of its files, the default first.
        audience: programs that read it.
        content: what is in it.
        target: "module:function" of the exporter, which takes an ``ExportRequest`` and returns ``ExportedFiles``.
        ups: frames that it can be written in ("y", "z", "camera"), the default first.
        stem: file name without suffix, if no path is given.
        extra: extra of ``physic-core`` that it needs, or "".
        module: module that the extra installs, or "".
        bodies: whether it needs people with a body.
        per_person: whether each person is a file of their own.
        scene: whether the scene is part of it.
        needs: what the user must have, or "".
    """

    name: str
    suffixes: tuple[str, ...]
    audience: str
    content: str
    target: str
    ups: tuple[str, ...]
    stem: str
    extra: str = ""
    module: str = ""
    bodies: bool = False
    scene: bool = True
    needs: str = ""
    per_person: bool = False

    @property
    def available(self) -> bool:
        """Whether the library that it needs is installed."""
        return not self.module or find_spec(self.module) is not None


_PACKAGE = "physic_core.visual.export"

FORMATS: tuple[Format, ...] = (
    Format(
        "amass",
        (".npz",),
        "Blender's SMPL-X add-on, AMASS tools",
        "SMPL-X parameters, one file per person",
        f"{_PACKAGE}.amass:export_amass",
        ("z", "y", "camera"),
        "amass",
        bodies=True,
        scene=False,
        needs="an SMPL-X file of yours (--body-model)",
        per_person=True,
    ),
    Format(
        "bvh",
        (".bvh",),
        "Blender, Maya, MotionBuilder",
        "skeleton and one pose, one file per person",
        f"{_PACKAGE}.bvh:export_bvh",
        ("y", "z"),
        "skeleton",
        bodies=True,
        scene=False,
        per_person=True,
    ),
    Format(
        "coco",
        (".json",),
        "labelling and evaluation tools",
        "boxes, masks, 17 keypoints, and the image",
        f"{_PACKAGE}.coco:export_coco",
        ("camera",),
        "coco",
        scene=False,
    ),
    Format(
        "glb",
        (".glb",),
        "Blender, Unity, Unreal, three.js",
        "skinned bodies, skeletons, contact, scene, floor, camera",
        "physic_core.visual.glb:export_glb",
        ("y",),
        "skinned",
    ),
    Format(
        "hot",
        (".json",),
        "contact labels of papers (HOT)",
        "contact of each body part, as polygons and areas",
        f"{_PACKAGE}.hot:export_hot",
        ("camera",),
        "contact",
        bodies=True,
        scene=False,
    ),
    Format(
        "mjcf",
        (".xml", ".mjcf"),
        "MuJoCo",
        "closed collision meshes of scene and people, floor, gravity",
        f"{_PACKAGE}.mjcf:export_mjcf",
        ("z",),
        "mujoco",
        needs="a floor in the result",
    ),
    Format(
        "obj",
        (".obj",),
        "MeshLab, Blender, 3ds Max",
        "meshes of scene and people with colours and normals",
        f"{_PACKAGE}.obj:export_obj",
        ("y", "z", "camera"),
        "meshes",
    ),
    Format(
        "ply",
        (".ply",),
        "MeshLab, CloudCompare, Open3D",
        "all scene points, meshes, colours, normals, contact",
        f"{_PACKAGE}.ply:export_ply",
        ("y", "z", "camera"),
        "points",
    ),
    Format(
        "usd",
        (".usdc", ".usda", ".usd", ".usdz"),
        "Omniverse, Isaac Sim, Houdini",
        "meshes, colliders, contact, camera",
        f"{_PACKAGE}.usd:export_usd",
        ("z", "y"),
        "stage",
        extra="usd",
        module="pxr",
        needs="a floor in the result, for z up",
    ),
)

_ELSEWHERE = {
    "fbx": (
        "FBX is a closed format that PhySIC does not write: export the skinned GLB (--to glb) and convert it with "
        "Blender, as docs/exports.md shows"
    ),
    "gltf": "the export is binary glTF: use --to glb, and a path that ends in .glb",
    "pkl": "pickles can run code when they are read: use --to amass, which writes .npz",
    "mp4": "a photo has no motion: use preview.png of the result",
}


def find_format(name: str | None, suffix: str = "") -> Format:
    """Return the format with a name or, without a name, the format of a file suffix (".glb").

    Raises:
        InputError: no format has this name or suffix, or several have the suffix.
    """
    wanted = (name or suffix.removeprefix(".")).lower()
    if wanted in _ELSEWHERE:
        raise InputError(f"cannot export to '{wanted}': {_ELSEWHERE[wanted]}")
    names = ", ".join(each.name for each in FORMATS)
    if name:
        for each in FORMATS:
            if each.name == wanted:
                return each
        raise InputError(f"there is no export format '{name}': choose one of {names}")
    found = [each for each in FORMATS if suffix.lower() in each.suffixes]
    if len(found) == 1:
        return found[0]
    if found:
        several = " or ".join(each.name for each in found)
        raise InputError(f"a file {suffix} can be {several}: state which (--to, or format= in Python)")
    what = f"'{suffix}' is the suffix of none" if suffix else "the path has no suffix"
    raise InputError(f"no export format is given, and {what}: choose one of {names} (--to, or format= in Python)")
