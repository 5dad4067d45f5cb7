#!/bin/sh
# A skinned mesh of UsdSkel, whose bind pose lies at the origin and whose animation moves it 3 m aside, is read by a
# simulator.
# Guessed: the mesh is left out, since a simulator has no skinning.
# Measured on 2026-11-27 with newton 1.8.0: it becomes a visible shape in the bind pose, at the origin, without a
# warning.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install newton==1.8.0 newton-usd-schemas usd-core==26.11 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import newton
import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

stage = Usd.Stage.CreateNew("person.usda")
UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
UsdGeom.SetStageMetersPerUnit(stage, 1.0)
UsdSkel.Root.Define(stage, "/person")
mesh = UsdGeom.Mesh.Define(stage, "/person/mesh")
mesh.CreatePointsAttr([Gf.Vec3f(0, 0, 0), Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0), Gf.Vec3f(0, 0, 1)])
mesh.CreateFaceVertexCountsAttr([3, 3, 3, 3])
mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2])
skeleton = UsdSkel.Skeleton.Define(stage, "/person/skeleton")
skeleton.CreateJointsAttr(["joint"])
skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1)])
skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1)])
motion = UsdSkel.Animation.Define(stage, "/person/motion")
motion.CreateJointsAttr(["joint"])
motion.CreateTranslationsAttr([Gf.Vec3f(3, 0, 0)])
motion.CreateRotationsAttr([Gf.Quatf(1)])
motion.CreateScalesAttr([Gf.Vec3h(1)])
UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([motion.GetPath()])
binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
binding.CreateJointIndicesPrimvar(False, 1).Set(Vt.IntArray([0] * 4))
binding.CreateJointWeightsPrimvar(False, 1).Set(Vt.FloatArray([1] * 4))
stage.Save()

builder = newton.ModelBuilder()
builder.add_usd("person.usda")
shape = builder.shape_label.index("/person/mesh")
place = np.array(builder.shape_transform[shape])[:3]
farthest = np.asarray(builder.shape_source[shape].vertices)[:, 0].max() + place[0]
visible = bool(int(builder.shape_flags[shape]) & int(newton.ShapeFlags.VISIBLE))
version = importlib.metadata.version("newton")
print(f"newton {version}: visible {visible}, largest x {farthest:.1f} m, where the posed mesh ends at 4.0 m")
if not (visible and abs(farthest - 1.0) < 1e-6):
    raise SystemExit("the behaviour has changed")
PYTHON
