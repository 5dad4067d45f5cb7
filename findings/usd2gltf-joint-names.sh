#!/bin/sh
# A USD skeleton states `joints`, and leaves out its `jointNames` and the mesh's own `skel:joints`, which OpenUSD's
# schema makes optional.
# Guessed: a converter to glTF writes the mesh without its skin.
# Measured on 2026-11-27 with usd2gltf 0.3.5: it ends with a TypeError. With both it writes mesh and skin.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install usd2gltf==0.3.5 usd-core==26.11 pygltflib==1.16.5
python - <<'PYTHON'
import importlib.metadata

import pygltflib
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from usd2gltf import converter


def converted(with_optional):
    stage = Usd.Stage.CreateInMemory()
    stage.SetDefaultPrim(UsdSkel.Root.Define(stage, "/person").GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/person/mesh")
    mesh.CreatePointsAttr([Gf.Vec3f(0, 0, 0), Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    skeleton = UsdSkel.Skeleton.Define(stage, "/person/skeleton")
    skeleton.CreateJointsAttr(["joint"])
    if with_optional:
        skeleton.CreateJointNamesAttr(["joint"])
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1)])
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1)])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    if with_optional:
        binding.CreateJointsAttr(["joint"])
    binding.CreateJointIndicesPrimvar(False, 1).Set(Vt.IntArray([0, 0, 0]))
    binding.CreateJointWeightsPrimvar(False, 1).Set(Vt.FloatArray([1, 1, 1]))
    try:
        converter.Converter().process(stage, "out.glb")
    except TypeError as failure:
        return type(failure).__name__
    return f"{len(pygltflib.GLTF2().load('out.glb').skins)} skin"


without = converted(False)
with_names = converted(True)
print(f"usd2gltf {importlib.metadata.version('usd2gltf')}: without them {without}, with them {with_names}")
if not (without == "TypeError" and with_names == "1 skin"):
    raise SystemExit("the behaviour has changed")
PYTHON
