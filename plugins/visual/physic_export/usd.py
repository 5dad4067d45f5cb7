"""USD: textured bodies with skeletons, colliders for physics, and the camera; metres, z up."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.body import NUM_JOINTS
from physic_core.errors import PhysicError
from physic_core.export import camera_pose
from physic_core.geometry import linear_from_srgb, rotmat_to_quat
from physic_export.meshes import ColoredMesh, person_meshes, scene_mesh
from physic_export.skeleton import at_rest, named_rig, t_pose
from physic_export.skins import Skins, skins_of
from physic_visual.floor import floor_rectangles
from physic_visual.glb import skin_influences
from physic_visual.palette import BODY_RGB, FLOOR_RGB, contact_legend
from physic_visual.rig import rigs
from physic_visual.scene_mesh import mesh_scene, scene_reach, unit_normals
from physic_visual.textures.dressed import dressed_bodies
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from physic_core.types import AnyArray, Float64Array, FloatArray, Int64Array, Intrinsics
    from physic_visual.rig import Rig

_ZIP_EPOCH = 315619200  # 1980-01-02, which no time zone moves before the first time of a zip file


def _add_variants(top: Any, mesh: Any, looks: Mapping[str, Any], shown: str) -> None:
    """Add a variant of the prim for each material of its mesh, and show one of them."""
    from pxr import UsdShade

    variants = top.GetVariantSets().AddVariantSet("skin")
    UsdShade.MaterialBindingAPI.Apply(mesh)
    for name, material in looks.items():
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            UsdShade.MaterialBindingAPI(mesh).Bind(material)
    variants.SetVariantSelection(shown if shown in looks else "neutral")


def _set_poses(animation: Any, poses: Iterable[tuple[Any, Rig]]) -> None:
    """Set the rotations and places of the joints of an animation by time. Their sizes stay."""
    from pxr import Gf, Vt

    translations = animation.CreateTranslationsAttr()
    rotations = animation.CreateRotationsAttr()
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * NUM_JOINTS))
    for time, posed in poses:
        places = Vt.Vec3fArray.FromNumpy(posed.offsets.astype(np.float32))
        turns = rotmat_to_quat(posed.rotations)
        quaternions = Vt.QuatfArray(
            [Gf.Quatf(float(w), float(x), float(y), float(z)) for x, y, z, w in turns]
        )
        translations.Set(places, time)
        rotations.Set(quaternions, time)


def add_skeleton(stage: Any, path: str, mesh: Any, rig: Rig, up: Float64Array) -> None:
    """Add ``skeleton`` and ``animation`` to a SkelRoot, and bind its mesh to them.

    Args:
        stage: the stage.
        path: of the SkelRoot, whose frame is that of the rig.
        mesh: in the bind pose of :func:`at_rest`.
        rig: in the pose.
        up: (3,) unit vector.
    """
    from pxr import Gf, Usd, UsdSkel, Vt

    standing = t_pose(rig, up)
    joints = _joint_paths(rig)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/skeleton")
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr(_matrices(np.linalg.inv(at_rest(rig, up).inverse_bind)))
    rest = np.tile(np.eye(4), (len(rig.names), 1, 1))
    rest[:, :3, :3] = standing.rotations
    rest[:, :3, 3] = standing.offsets
    skeleton.CreateRestTransformsAttr(_matrices(rest))
    animation = UsdSkel.Animation.Define(stage, f"{path}/animation")
    animation.CreateJointsAttr(joints)
    _set_poses(animation, ((Usd.TimeCode.Default(), rig), (0, standing), (1, rig)))
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    indices, weights = skin_influences(rig.weights)
    count = indices.shape[1]
    binding.CreateJointIndicesPrimvar(False, count).Set(
        Vt.IntArray.FromNumpy(indices.reshape(-1).astype(np.int32))
    )
    binding.CreateJointWeightsPrimvar(False, count).Set(
        Vt.FloatArray.FromNumpy(weights.reshape(-1))
    )


def _joint_paths(rig: Rig) -> list[str]:
    """Return the path of each joint, such as "pelvis/left_hip/left_knee"."""
    paths: list[str] = []
    for name, parent in zip(rig.names, rig.parents, strict=True):
        paths.append(name if parent < 0 else f"{paths[parent]}/{name}")
    return paths


def _matrices(matrices: FloatArray) -> Any:
    """Return (n, 4, 4) matrices as USD has them: it multiplies row vectors from the left."""
    from pxr import Gf, Vt

    return Vt.Matrix4dArray([Gf.Matrix4d(*one.T.reshape(-1).tolist()) for one in matrices])


def export_usd(request: ExportRequest) -> ExportedFiles:
    """Return one USD file (.usdc, .usda, .usd or .usdz) with the default prim ``/physic``, and its
    pictures.

    - ``/physic/person_0``, ...: a SkelRoot with ``mesh``, ``skeleton`` and ``animation`` (T-pose at
      time 0, the pose at time 1, where the stage starts), and the posed mesh ``collider``, which is
      not drawn. The variant set ``skin`` has "photo", "neutral" and "contact". The primvars
      ``contact`` and ``filled`` are in 0-1 per vertex.
    - ``/physic/scene``: a mesh. ``/physic/floor``: the plane, which is not drawn;
      ``/physic/drawn_floor``: a mesh of the floor where the scene does not show it.
    - ``/physic/camera``: the photo's field of view and principal point.

    Scene, floor and people are static colliders, exact or, for people, by their convex
    decomposition.
    """
    from pxr import UsdUtils

    frame = request.frame
    skins = skins_of(request)
    pictures = skins.pictures()
    notes = list(skins.notes)
    try:
        style = str(request.options["names"])
        up = request.frame.up_vector
        rigged = {index: named_rig(rig, style, up) for index, rig in rigs(request)}
    except PhysicError as error:
        rigged = {}
        notes.append(f"the bodies have no skeleton: {error}")
    with tempfile.TemporaryDirectory() as folder:
        path = (
            Path(folder)
            / f"{request.stem}{'.usdc' if request.suffix == '.usdz' else request.suffix}"
        )
        stage = _new_stage(path, request)
        for index, mesh in zip(request.person, person_meshes(request, skins), strict=True):
            _add_person(stage, mesh, skins, index, rigged.get(index))
        if request.scene:
            pictures |= _add_textured_scene(stage, request)
            _add_floor(stage, request)
        _add_camera(stage, request.result.intrinsics, camera_pose(frame))
        _add_gravity(stage, frame.up_vector)
        for name, content in pictures.items():
            (Path(folder) / name).write_bytes(content)
        stage.Save()
        if request.suffix == ".usdz":
            for part in Path(folder).iterdir():
                os.utime(part, (_ZIP_EPOCH, _ZIP_EPOCH))
            packed = path.with_suffix(".usdz")
            UsdUtils.CreateNewUsdzPackage(str(path), str(packed))
            path = packed
            pictures = {}
        content = path.read_bytes()
    return ExportedFiles({f"{request.stem}{request.suffix}": content, **pictures}, tuple(notes))


def _new_stage(path: Path, request: ExportRequest) -> Any:
    """Return a stage with units, axes and the legend of contact, and the default prim."""
    from pxr import Usd, UsdGeom, Vt

    frame = request.frame
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if frame.up == "z" else UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(1)
    stage.SetMetadata("comment", f"PhySIC; meters; {frame.axes}")
    legend = [
        f"{name}: sRGB {rgb[0]} {rgb[1]} {rgb[2]}"  # names have blanks: no keys of a dictionary
        for name, rgb in contact_legend(request.result).items()
    ]
    stage.SetMetadata("customLayerData", {"contact_colors": Vt.StringArray(legend)})
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/physic").GetPrim())
    return stage


def _add_person(stage: Any, mesh: ColoredMesh, skins: Skins, index: int, rig: Rig | None) -> None:
    """Add a person: a mesh in the bind pose with a skeleton, or posed without one, and its
    collider.
    """
    from pxr import Sdf, UsdGeom, UsdPhysics, UsdSkel, Vt

    path = f"/physic/{mesh.name}"
    top = UsdSkel.Root.Define(stage, path) if rig is not None else UsdGeom.Xform.Define(stage, path)
    drawn = mesh
    if rig is not None:  # in the bind pose, near the T-pose, whose bounds OpenUSD widens by both
        bound = at_rest(rig, skins.request.frame.up_vector).vertices
        drawn = replace(mesh, vertices=bound, normals=unit_normals(bound, mesh.faces))
    prim = _add_mesh(stage, f"{path}/mesh", drawn)
    prim.CreateDoubleSidedAttr(False)
    primvars = UsdGeom.PrimvarsAPI(prim)
    values = {"contact": mesh.contact.astype(np.float32)}
    if skins.mesh is not None:
        values["filled"] = dressed_bodies(skins.request.result).people[index].guessed_share
        _add_uv(prim, skins.mesh.uv, skins.mesh.faces)
    for name, numbers in values.items():
        primvar = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        primvar.Set(Vt.FloatArray.FromNumpy(numbers))
    if rig is not None:
        add_skeleton(stage, path, prim, rig, skins.request.frame.up_vector)
    looks = {"neutral": _add_material(stage, f"{path}/looks/neutral", color=BODY_RGB)}
    if skins.source:
        stem = f"{skins.request.stem}_{mesh.name}"
        for name, picture in (("photo", f"{stem}.jpg"), ("contact", f"{stem}_contact.png")):
            looks[name] = _add_material(stage, f"{path}/looks/{name}", picture=picture)
    _add_variants(top.GetPrim(), prim.GetPrim(), looks, skins.kind)
    collider = _add_mesh(stage, f"{path}/collider", mesh)
    collider.CreatePurposeAttr(UsdGeom.Tokens.guide)
    _make_collider(collider, UsdPhysics.Tokens.convexDecomposition)


def _usd_extent(points: AnyArray) -> list[Any]:
    """Return the lower and the upper corner of the box around points (V, 3)."""
    from pxr import Gf

    return [Gf.Vec3f(*map(float, corner)) for corner in (points.min(0), points.max(0))]


def _add_textured_scene(stage: Any, request: ExportRequest) -> dict[str, bytes]:
    """Add the scene, and return its picture."""
    from pxr import UsdPhysics, UsdShade

    scene = scene_mesh(request)
    if scene is None or scene.uv is None:
        return {}
    mesh = _add_mesh(stage, "/physic/scene", scene)
    name = f"{request.stem}_scene.jpg"
    _add_uv(mesh, scene.uv, scene.faces)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(
        _add_material(stage, "/physic/looks/scene", picture=name)
    )
    _make_collider(mesh, UsdPhysics.Tokens.none)
    return {name: encode_image(request.result.scene.colors, "JPEG")}


def _add_floor(stage: Any, request: ExportRequest) -> None:
    """Add the floor: a square under everything that collides, and what is drawn of it."""
    from pxr import UsdGeom, UsdPhysics

    surface = mesh_scene(request.result.scene, scene_reach(request.result))
    drawn = floor_rectangles(request.result, request.frame, surface)
    if drawn is None:
        return
    up = request.frame.up_vector
    plane = UsdGeom.Plane.Define(stage, "/physic/floor")
    plane.CreateAxisAttr(UsdGeom.Tokens.z if up[2] else UsdGeom.Tokens.y)
    plane.CreatePurposeAttr(UsdGeom.Tokens.guide)
    UsdPhysics.CollisionAPI.Apply(plane.GetPrim())
    vertices, faces = drawn
    if len(faces):
        normals = np.tile(up, (len(vertices), 1)).astype(np.float32)
        colors = np.tile(np.array(FLOOR_RGB, np.uint8), (len(vertices), 1))
        _add_mesh(
            stage,
            "/physic/drawn_floor",
            ColoredMesh("floor", vertices, faces, normals, colors, np.zeros(len(vertices), bool)),
        )


def _add_mesh(stage: Any, path: str, mesh: ColoredMesh) -> Any:
    """Add a mesh with normals and displayColor, and return it."""
    from pxr import Sdf, UsdGeom, Vt

    def vectors(values: AnyArray) -> Any:
        return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))

    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(vectors(mesh.vertices))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, np.int32)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.faces.reshape(-1).astype(np.int32)))
    prim.CreateNormalsAttr(vectors(mesh.normals))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(_usd_extent(mesh.vertices))
    prim.CreateDoubleSidedAttr(True)
    primvars = UsdGeom.PrimvarsAPI(prim)
    color = primvars.CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
    )
    color.Set(vectors(linear_from_srgb(mesh.colors)))
    return prim


def _make_collider(mesh: Any, shape: str) -> None:
    """Make a mesh a static collider."""
    from pxr import UsdPhysics

    UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
    UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(shape)


def _add_uv(mesh: Any, uv: AnyArray, corners: Int64Array) -> None:
    """Add texture coordinates (U, 2) and the indices (F, 3) of the corners."""
    from pxr import Sdf, UsdGeom, Vt

    kind = Sdf.ValueTypeNames.TexCoord2fArray
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.faceVarying)
    primvar.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(uv, np.float32)))
    primvar.SetIndices(Vt.IntArray.FromNumpy(corners.reshape(-1).astype(np.int32)))


def _add_material(
    stage: Any, path: str, picture: str = "", color: tuple[int, int, int] = (255, 255, 255)
) -> Any:
    """Add a matte material with a picture, or with an sRGB colour."""
    from pxr import Gf, Sdf, UsdGeom, UsdShade

    kinds = Sdf.ValueTypeNames
    UsdGeom.Scope.Define(stage, path.rpartition("/")[0])  # else the folder has no type
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", kinds.Float).Set(0.9)
    diffuse = surface.CreateInput("diffuseColor", kinds.Color3f)
    diffuse.Set(Gf.Vec3f(*linear_from_srgb(np.array(color, np.uint8)).tolist()))
    if picture:
        reader = UsdShade.Shader.Define(stage, f"{path}/uv")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", kinds.String).Set("st")
        texture = UsdShade.Shader.Define(stage, f"{path}/picture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", kinds.Asset).Set(Sdf.AssetPath(f"./{picture}"))
        texture.CreateInput("sourceColorSpace", kinds.Token).Set("sRGB")
        for side in ("wrapS", "wrapT"):
            texture.CreateInput(side, kinds.Token).Set("clamp")
        texture.CreateInput("st", kinds.Float2).ConnectToSource(
            reader.CreateOutput("result", kinds.Float2)
        )
        diffuse.ConnectToSource(texture.CreateOutput("rgb", kinds.Float3))
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", kinds.Token))
    return material


_APERTURE = 36.0
"""Width of the film, in tenths of a scene unit as USD has it; only its ratio to the focal length
matters.
"""


def _add_camera(stage: Any, camera: Intrinsics, pose: Float64Array) -> None:
    from pxr import Gf, UsdGeom

    prim = UsdGeom.Camera.Define(stage, "/physic/camera")
    focal = _APERTURE * camera.fx / camera.width
    height = focal * camera.height / camera.fy
    prim.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    prim.CreateFocalLengthAttr(focal)
    prim.CreateHorizontalApertureAttr(_APERTURE)
    prim.CreateVerticalApertureAttr(height)
    prim.CreateHorizontalApertureOffsetAttr(
        _APERTURE * ((camera.width - 1) / 2 - camera.cx) / camera.width
    )
    prim.CreateVerticalApertureOffsetAttr(
        height * (camera.cy - (camera.height - 1) / 2) / camera.height
    )
    prim.CreateClippingRangeAttr(Gf.Vec2f(0.05, 1000.0))
    prim.AddTransformOp().Set(_matrices(pose[None])[0])


def _add_gravity(stage: Any, up: Float64Array) -> None:
    from pxr import Gf, UsdPhysics

    scene = UsdPhysics.Scene.Define(stage, "/physic/physics")
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*(-up).tolist()))
    scene.CreateGravityMagnitudeAttr(9.81)
