"""Formats of ``physic export`` for other programs, from AMASS to USD."""

from __future__ import annotations

from typing import Any

from physic_core import ExporterRecord, hookimpl

__all__: list[str] = []

_NAMES = {"names": ("smplx", "mixamo", "unreal", "unity", "vrm")}
_SKIN = {"skin": ("photo", "neutral", "contact")}
_TEXTURES: dict[str, tuple[str | bool, ...]] = {
    "texture_size": ("1024", "512", "2048", "4096"),
    "contact_texture": (False, True),
}


def _exporter_record(
    name: str, suffixes: str, audience: str, content: str, *, module: str = "", **more: Any
) -> ExporterRecord:
    """Return the record of the function ``export_NAME`` in the module NAME, or another one."""
    target = f"physic_export.{module or name}:export_{name}"
    return ExporterRecord(name, tuple(suffixes.split()), target, audience, content, **more)


_FORMATS = (
    _exporter_record(
        "amass",
        ".npz",
        "Blender's SMPL-X add-on, AMASS tools",
        "SMPL-X parameters, one file per person",
        ups=("z", "y", "camera"),
        bodies="required",
        per_person=True,
        needs="an SMPL-X file of yours (--body-model)",
    ),
    _exporter_record(
        "bodies",
        ".npz",
        "physic run --bodies, Python",
        "parameters of all people, body model and camera",
        ups=("camera",),
        bodies="required",
    ),
    _exporter_record(
        "bvh",
        ".bvh",
        "Blender, Maya, MotionBuilder",
        "skeleton, T-pose and pose, one file per person",
        ups=("y", "z"),
        stem="skeleton",
        bodies="required",
        per_person=True,
        options={"names": ("mixamo", "smplx", "unreal", "unity", "vrm")},
    ),
    _exporter_record(
        "coco",
        ".json",
        "CVAT, FiftyOne, pycocotools",
        "2D keypoints, boxes and masks of people, px of the photo file",
        ups=("camera",),
        bodies="required",
    ),
    _exporter_record(
        "colmap",
        ".bin",
        "COLMAP, gsplat, Gaussian splatting",
        "camera, photo, mask without people, points of the scene",
        ups=("camera", "z", "y"),
        stem="sparse/0/cameras",
    ),
    _exporter_record(
        "depth",
        ".png",
        "OpenCV, Open3D, Python",
        "depth of the scene in millimeters, photo, masks of people, camera",
        ups=("camera",),
    ),
    _exporter_record(
        "exr",
        ".exr",
        "Blender, Nuke, OpenCV",
        "depth in meters without and with people, mask of what is inpainted, camera",
        ups=("camera",),
        stem="zdepth",
        packages=("OpenEXR",),
        extra="exr",
    ),
    _exporter_record(
        "glb",
        ".glb",
        "Blender, Unity, Unreal, three.js",
        "textured bodies, skeletons, T-pose and pose, contact, scene, floor, camera",
        stem="skinned",
        options=_NAMES | _SKIN | _TEXTURES | {"plain": (False, True), "rest_pose": (False, True)},
    ),
    _exporter_record(
        "keypoints",
        ".csv",
        "physic run --keypoints, pandas",
        "2D keypoints of people, px of the photo file",
        ups=("camera",),
        bodies="required",
    ),
    _exporter_record(
        "mjcf",
        ".xml .mjcf",
        "MuJoCo",
        "people with joints and actuators, textured scene with collision meshes, floor, gravity",
        ups=("z",),
        stem="mujoco",
        needs="a floor in the result",
        options={"rigid": (False, True), "keep_lean": (False, True)},
    ),
    _exporter_record(
        "mot",
        ".mot",
        "OpenSim",
        "pose as coordinates of the Rajagopal model, one file per person",
        module="opensim",
        ups=("y",),
        stem="motion",
        bodies="required",
        per_person=True,
    ),
    _exporter_record(
        "nerfstudio",
        ".json",
        "nerfstudio, Gaussian splatting",
        "transforms.json with photo, depth, mask and camera",
        module="depth",
        ups=("z", "y", "camera"),
        stem="transforms",
        needs="a floor in the result, for z up",
    ),
    _exporter_record(
        "obj",
        ".obj",
        "MeshLab, Blender, 3ds Max",
        "meshes of scene and people with textures and normals",
        module="meshes",
        ups=("y", "z", "camera"),
        stem="meshes",
        options=_SKIN | {"texture_size": _TEXTURES["texture_size"]},
    ),
    _exporter_record(
        "ply",
        ".ply",
        "MeshLab, CloudCompare, Open3D",
        "all scene points, meshes, colors, normals, contact",
        module="meshes",
        ups=("y", "z", "camera"),
        stem="points",
        options=_SKIN,
    ),
    _exporter_record(
        "rrd",
        ".rrd",
        "Rerun",
        "photo, depth, points, bodies, contact and camera on a timeline",
        ups=("y", "z", "camera"),
        stem="recording",
        packages=("rerun",),
        extra="rrd",
        options=_SKIN,
    ),
    _exporter_record(
        "stl",
        ".stl",
        "PrusaSlicer, Cura, 3D printers",
        "closed bodies in millimeters, one file per person",
        module="meshes",
        ups=("z", "y", "camera"),
        stem="print",
        bodies="required",
        per_person=True,
        needs="a floor in the result, for z up",
    ),
    _exporter_record(
        "trc",
        ".trc",
        "OpenSim, Visual3D",
        "joints as markers in millimeters, one file per person",
        module="opensim",
        ups=("y",),
        stem="markers",
        bodies="required",
        per_person=True,
    ),
    _exporter_record(
        "urdf",
        ".urdf",
        "ROS, PyBullet, Isaac Sim, Drake",
        "a robot with joints, meshes and masses, and the pose (.json), one of each per person",
        ups=("z",),
        stem="robot",
        bodies="required",
        per_person=True,
        needs="a floor in the result",
        options={"keep_lean": (False, True)},
    ),
    _exporter_record(
        "usd",
        ".usdc .usda .usd .usdz",
        "Omniverse, Isaac Sim, Houdini",
        "textured meshes, skeletons, colliders, contact, camera",
        ups=("z", "y"),
        stem="stage",
        needs="a floor in the result, for z up",
        packages=("pxr",),
        extra="usd",
        options=_NAMES | _SKIN | {"texture_size": _TEXTURES["texture_size"]},
    ),
)


@hookimpl
def physic_exporters() -> list[ExporterRecord]:
    """Return one record per format."""
    return list(_FORMATS)
