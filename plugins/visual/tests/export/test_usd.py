"""USD: opened by pxr, and checked by its validators."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pxr")

from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdSkel, UsdUtils


@pytest.fixture(scope="module")
def stage(result, tmp_path_factory):
    return Usd.Stage.Open(
        str(result.export(str(tmp_path_factory.mktemp("usd") / "a.usdc")).files[0])
    )


def test_the_usd_stage_is_in_metres_with_z_up(stage):
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/physic"
    tops = [str(prim.GetPath()) for prim in stage.GetDefaultPrim().GetChildren()]
    assert tops == [
        *(
            "/physic/person_0",
            "/physic/person_1",
            "/physic/scene",
            "/physic/looks",
            "/physic/floor",
        ),
        *("/physic/drawn_floor", "/physic/camera", "/physic/physics"),
    ]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 1)


def test_every_prim_has_a_type(stage):
    assert [prim.GetPath() for prim in stage.TraverseAll() if not prim.GetTypeName()] == []
    assert stage.GetPrimAtPath("/physic/person_0/looks").GetTypeName() == "Scope"


def skinned_points(stage, index, time):
    """Points of a body as UsdSkel poses them."""
    root = UsdSkel.Root.Get(stage, f"/physic/person_{index}")
    mesh = UsdGeom.Mesh.Get(stage, f"/physic/person_{index}/mesh")
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, f"/physic/person_{index}/skeleton"))
    transforms = skeleton.ComputeSkinningTransforms(time)
    points = mesh.GetPointsAttr().Get()
    assert cache.GetSkinningQuery(mesh.GetPrim()).ComputeSkinnedPoints(transforms, points, time)
    return np.array(points)


def test_skinned_bodies_and_their_contact_are_those_of_the_result(stage, result, in_frame):
    for index, person in enumerate(result.people):
        mesh = UsdGeom.Mesh.Get(stage, f"/physic/person_{index}/mesh")
        wanted = in_frame(person.vertices)
        np.testing.assert_allclose(skinned_points(stage, index, 1), wanted, atol=1e-4)
        collider = UsdGeom.Mesh.Get(stage, f"/physic/person_{index}/collider")
        np.testing.assert_allclose(collider.GetPointsAttr().Get(), wanted, atol=1e-5)
        np.testing.assert_array_equal(
            np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), result.faces
        )
        contact = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("contact")
        assert contact.GetInterpolation() == "vertex"
        np.testing.assert_array_equal(contact.Get(), person.contact)


def test_time_0_is_a_t_pose_on_the_floor(stage):
    points = skinned_points(stage, 0, 0)
    low = points.min(0)
    high = points.max(0)
    assert low[2] == pytest.approx(0, abs=1e-4)
    assert np.linalg.norm((high - low)[:2]) > 1.5
    assert high[2] > 1.5


def test_the_camera_projects_a_vertex_onto_its_pixel(stage, result, in_frame):
    camera = UsdGeom.Camera.Get(stage, "/physic/camera").GetCamera()
    intrinsics = result.intrinsics
    frustum = camera.frustum
    projection = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    for vertex in result.people[0].vertices[::1000].astype(np.float64):
        x, y, _ = projection.Transform(Gf.Vec3d(*in_frame(vertex).tolist()))
        u, v, depth = intrinsics.matrix @ vertex
        np.testing.assert_allclose((x + 1) / 2 * intrinsics.width - 0.5, u / depth, atol=1e-2)
        np.testing.assert_allclose((1 - y) / 2 * intrinsics.height - 0.5, v / depth, atol=1e-2)


def test_physics_falls_down_and_stops_at_scene_and_floor(stage):
    gravity = UsdPhysics.Scene.Get(stage, "/physic/physics")
    np.testing.assert_allclose(gravity.GetGravityDirectionAttr().Get(), [0, 0, -1])
    floor = stage.GetPrimAtPath("/physic/floor")
    assert floor.HasAPI(UsdPhysics.CollisionAPI)
    assert UsdGeom.Plane(floor).GetAxisAttr().Get() == "Z"
    for name, shape in (("scene", "none"), ("person_0/collider", "convexDecomposition")):
        prim = stage.GetPrimAtPath(f"/physic/{name}")
        assert prim.HasAPI(UsdPhysics.CollisionAPI)
        assert UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get() == shape


@pytest.mark.parametrize("suffix", [".usda", ".usdz"])
def test_the_validators_of_usd_find_nothing(export, suffix):
    path = str(export(f"a{suffix}", person=0).files[0])
    # what usdchecker ran, until it was replaced by the validators
    if hasattr(UsdUtils, "ComplianceChecker"):
        checker = UsdUtils.ComplianceChecker()
        checker.CheckCompliance(path)
        assert checker.GetErrors() + checker.GetFailedChecks() + checker.GetWarnings() == []
        return
    from pxr import UsdValidation

    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(path))
    assert [error.GetErrorAsString() for error in errors] == []
