#!/bin/sh
# OpenUSD computes the bounds of a SkelRoot that states no extent, whose mesh rests at the origin and whose one joint
# rests 10 m away; the pose equals the rest, so the mesh stays at the origin.
# Guessed: the bounds are those of the mesh (1 m).
# Measured on 2026-11-27 with usd-core 26.11: they are those of the joint, widened by its distance from the mesh:
# about 20 m.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install usd-core==26.11
python - <<'PYTHON'
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

stage = Usd.Stage.CreateInMemory()
root = UsdSkel.Root.Define(stage, "/person")
mesh = UsdGeom.Mesh.Define(stage, "/person/mesh")
corners = [Gf.Vec3f(0, 0, 0), Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 1)]
mesh.CreatePointsAttr(corners)
mesh.CreateFaceVertexCountsAttr([3])
mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
mesh.CreateExtentAttr([Gf.Vec3f(0), Gf.Vec3f(1)])
skeleton = UsdSkel.Skeleton.Define(stage, "/person/skeleton")
resting = Gf.Matrix4d().SetTranslate(Gf.Vec3d(10, 0, 0))
skeleton.CreateJointsAttr(["joint"])
skeleton.CreateBindTransformsAttr([resting])
skeleton.CreateRestTransformsAttr([resting])
binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
binding.CreateJointIndicesPrimvar(False, 1).Set(Vt.IntArray([0, 0, 0]))
binding.CreateJointWeightsPrimvar(False, 1).Set(Vt.FloatArray([1, 1, 1]))


def width():
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(root.GetPrim()).ComputeAlignedRange()
    return box.GetSize()[0]


unstated = width()
UsdGeom.Boundable(root).CreateExtentAttr([Gf.Vec3f(0), Gf.Vec3f(1)])
stated = width()
print(f"usd {Usd.GetVersion()}: width {unstated:.1f} m without extent, {stated:.1f} m with")
if not (unstated > 15 and abs(stated - 1) < 1e-6):
    raise SystemExit("the behaviour has changed")
PYTHON
