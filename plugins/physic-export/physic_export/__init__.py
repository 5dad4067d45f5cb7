"""Formats of ``physic export`` for other programs, from AMASS to USD."""

from __future__ import annotations

from physic_core import ExporterRecord, hookimpl

__all__: list[str] = []

_NAMES = {"names": ("smplx", "mixamo", "unreal", "unity")}
_SKIN = {"skin": ("photo", "neutral", "contact")}
_TEXTURES: dict[str, tuple[str | bool, ...]] = {
    "texture_size": ("1024", "512", "2048", "4096"),
    "contact_texture": (False, True),
}


@hookimpl
def physic_exporters() -> list[ExporterRecord]:
    """Return one record per format."""
    return [
        ExporterRecord(
            "amass",
            (".npz",),
            "physic_export.amass:export_amass",
            "Blender's SMPL-X add-on, AMASS tools",
            "SMPL-X parameters, one file per person",
            ups=("z", "y", "camera"),
            bodies="required",
            per_person=True,
            needs="an SMPL-X file of yours (--body-model)",
        ),
        ExporterRecord(
            "bvh",
            (".bvh",),
            "physic_export.bvh:export_bvh",
            "Blender, Maya, MotionBuilder",
            "skeleton, T-pose and pose, one file per person",
            ups=("y", "z"),
            stem="skeleton",
            bodies="required",
            per_person=True,
            options={"names": ("mixamo", "smplx", "unreal", "unity", "lafan")},
        ),
        ExporterRecord(
            "coco",
            (".json",),
            "physic_export.coco:export_coco",
            "CVAT, FiftyOne, pycocotools",
            "2D keypoints, boxes and masks of people, px of the photo file",
            ups=("camera",),
            bodies="required",
        ),
        ExporterRecord(
            "colmap",
            (".bin",),
            "physic_export.colmap:export_colmap",
            "COLMAP, gsplat, Gaussian splatting",
            "camera, photo, mask without people, points of the scene",
            ups=("camera", "z", "y"),
            stem="sparse/0/cameras",
        ),
        ExporterRecord(
            "depth",
            (".png",),
            "physic_export.depth:export_depth",
            "OpenCV, Open3D, Python",
            "depth of the scene in millimetres, photo, masks of people, camera",
            ups=("camera",),
        ),
        ExporterRecord(
            "glb",
            (".glb",),
            "physic_export.glb:export_glb",
            "Blender, Unity, Unreal, three.js",
            "textured bodies, skeletons, T-pose and pose, contact, scene, floor, camera",
            stem="skinned",
            options=_NAMES | _SKIN | _TEXTURES,
        ),
        ExporterRecord(
            "keypoints",
            (".csv",),
            "physic_export.keypoints:export_keypoints",
            "physic run --keypoints, pandas",
            "2D keypoints of people, px of the photo file",
            ups=("camera",),
            bodies="required",
        ),
        ExporterRecord(
            "mjcf",
            (".xml", ".mjcf"),
            "physic_export.mjcf:export_mjcf",
            "MuJoCo",
            "people with joints and actuators, textured scene with collision meshes, floor, "
            "gravity",
            ups=("z",),
            stem="mujoco",
            needs="a floor in the result",
            options={"rigid": (False, True), "keep_lean": (False, True)},
        ),
        ExporterRecord(
            "nerfstudio",
            (".json",),
            "physic_export.depth:export_nerfstudio",
            "nerfstudio, Gaussian splatting",
            "transforms.json with photo, depth, mask and camera",
            ups=("z", "y", "camera"),
            stem="transforms",
            needs="a floor in the result, for z up",
        ),
        ExporterRecord(
            "obj",
            (".obj",),
            "physic_export.meshes:export_obj",
            "MeshLab, Blender, 3ds Max",
            "meshes of scene and people with textures and normals",
            ups=("y", "z", "camera"),
            stem="meshes",
            options=_SKIN | {"texture_size": _TEXTURES["texture_size"]},
        ),
        ExporterRecord(
            "ply",
            (".ply",),
            "physic_export.meshes:export_ply",
            "MeshLab, CloudCompare, Open3D",
            "all scene points, meshes, colours, normals, contact",
            ups=("y", "z", "camera"),
            stem="points",
            options=_SKIN,
        ),
        ExporterRecord(
            "rrd",
            (".rrd",),
            "physic_export.rrd:export_rrd",
            "Rerun",
            "photo, depth, points, bodies, contact and camera on a timeline",
            ups=("y", "z", "camera"),
            stem="recording",
            packages=("rerun",),
            extra="rrd",
            options=_SKIN,
        ),
        ExporterRecord(
            "urdf",
            (".urdf",),
            "physic_export.urdf:export_urdf",
            "ROS, PyBullet, Isaac Sim, Drake",
            "a robot with joints, meshes and masses, and the pose (.json), one of each per person",
            ups=("z",),
            stem="robot",
            bodies="required",
            per_person=True,
            needs="a floor in the result",
            options={"keep_lean": (False, True)},
        ),
        ExporterRecord(
            "usd",
            (".usdc", ".usda", ".usd", ".usdz"),
            "physic_export.usd:export_usd",
            "Omniverse, Isaac Sim, Houdini",
            "textured meshes, skeletons, colliders, contact, camera",
            ups=("z", "y"),
            stem="stage",
            needs="a floor in the result, for z up",
            packages=("pxr",),
            extra="usd",
            options=_NAMES | _SKIN | {"texture_size": _TEXTURES["texture_size"]},
        ),
    ]
