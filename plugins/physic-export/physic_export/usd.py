"""USD: meshes with colours and contact, colliders for physics, and the camera; metres, z up."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.visual.export.request import camera_pose
from physic_core.visual.palette import FLOOR_RGB, contact_legend, linear_from_srgb
from physic_core.visual.surface import floor_square
from physic_export.meshes import ColoredMesh, person_meshes, scene_mesh

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Intrinsics

__all__ = ["export_usd"]

_APERTURE = 36.0
"""Width of the film, in tenths of a scene unit as USD has it; only its ratio to the focal length matters."""


def export_usd(request: ExportRequest) -> ExportedFiles:
    """Return one USD file (.usdc, .usda, .usd or .usdz) with the default prim ``/physic``.

    ``/physic/scene``, ``/physic/floor`` and ``/physic/person_0``, ... are meshes with normals and displayColor; people
    have the primvar ``contact``, 1 or 0 per vertex, and the colour of what they touch, which ``contact_colors`` of the
    layer's custom data names. Scene, floor and people are static colliders, exact or, for people,
    by their convex decomposition. ``/physic/camera`` has the photo's field of view and principal point.
    """
    from pxr import Usd, UsdGeom, UsdUtils

    frame = request.frame
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{request.stem}{'.usdc' if request.suffix == '.usdz' else request.suffix}"
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if frame.up == "z" else UsdGeom.Tokens.y)
        stage.SetMetadata("comment", f"PhySIC; metres; {frame.axes}")
        legend = {name: f"sRGB {rgb[0]} {rgb[1]} {rgb[2]}" for name, rgb in contact_legend(request.result).items()}
        stage.SetMetadata("customLayerData", {"contact_colors": legend})
        root = UsdGeom.Xform.Define(stage, "/physic")
        stage.SetDefaultPrim(root.GetPrim())
        for mesh in _meshes(request):
            _add_mesh(stage, mesh)
        _add_camera(stage, request.result.intrinsics, camera_pose(frame))
        _add_gravity(stage, frame.up_vector)
        stage.Save()
        if request.suffix == ".usdz":
            packed = path.with_suffix(".usdz")
            UsdUtils.CreateNewUsdzPackage(str(path), str(packed))
            path = packed
        content = path.read_bytes()
    return ExportedFiles({f"{request.stem}{request.suffix}": content})


def _meshes(request: ExportRequest) -> list[ColoredMesh]:
    meshes = person_meshes(request)
    if not request.scene:
        return meshes
    scene, square = scene_mesh(request), floor_square(request.result, request.frame)
    if scene is not None:
        meshes.append(scene)
    if square is not None:
        vertices, faces = square
        normals = np.tile(request.frame.up_vector, (4, 1)).astype(np.float32)
        colors = np.tile(np.array(FLOOR_RGB, np.uint8), (4, 1))
        meshes.append(ColoredMesh("floor", vertices, faces, normals, colors, np.zeros(4, bool)))
    return meshes


def _add_mesh(stage: Any, mesh: ColoredMesh) -> None:
    """Add a mesh as a static collider."""
    from pxr import Gf, Sdf, UsdGeom, UsdPhysics, Vt

    def vectors(values: NDArray[Any]) -> Any:
        return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))

    made = UsdGeom.Mesh.Define(stage, f"/physic/{mesh.name}")
    made.CreatePointsAttr(vectors(mesh.vertices))
    made.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, np.int32)))
    made.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.faces.reshape(-1).astype(np.int32)))
    made.CreateNormalsAttr(vectors(mesh.normals))
    made.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    made.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    low, high = (Gf.Vec3f(*map(float, edge)) for edge in (mesh.vertices.min(0), mesh.vertices.max(0)))
    made.CreateExtentAttr([low, high])
    person = mesh.name.startswith("person")
    made.CreateDoubleSidedAttr(not person)
    primvars = UsdGeom.PrimvarsAPI(made)
    color = primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
    color.Set(vectors(linear_from_srgb(mesh.colors)))
    if person:
        contact = primvars.CreatePrimvar("contact", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        contact.Set(Vt.FloatArray.FromNumpy(mesh.contact.astype(np.float32)))
    UsdPhysics.CollisionAPI.Apply(made.GetPrim())
    shape = UsdPhysics.Tokens.convexDecomposition if person else UsdPhysics.Tokens.none
    UsdPhysics.MeshCollisionAPI.Apply(made.GetPrim()).CreateApproximationAttr(shape)


def _add_camera(stage: Any, camera: Intrinsics, pose: NDArray[np.float64]) -> None:
    from pxr import Gf, UsdGeom

    made = UsdGeom.Camera.Define(stage, "/physic/camera")
    focal = _APERTURE * camera.fx / camera.width
    height = focal * camera.height / camera.fy
    made.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    made.CreateFocalLengthAttr(focal)
    made.CreateHorizontalApertureAttr(_APERTURE)
    made.CreateVerticalApertureAttr(height)
    made.CreateHorizontalApertureOffsetAttr(_APERTURE * ((camera.width - 1) / 2 - camera.cx) / camera.width)
    made.CreateVerticalApertureOffsetAttr(height * (camera.cy - (camera.height - 1) / 2) / camera.height)
    made.CreateClippingRangeAttr(Gf.Vec2f(0.05, 1000.0))
    # USD multiplies row vectors from the left.
    made.AddTransformOp().Set(Gf.Matrix4d(*pose.T.reshape(-1).tolist()))


def _add_gravity(stage: Any, up: NDArray[np.float64]) -> None:
    from pxr import Gf, UsdPhysics

    scene = UsdPhysics.Scene.Define(stage, "/physic/physics")
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*(-up).tolist()))
    scene.CreateGravityMagnitudeAttr(9.81)
