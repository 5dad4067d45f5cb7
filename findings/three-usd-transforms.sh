#!/bin/sh
# A USD mesh has a point at 1, 2, 3. It is turned by rotateXYZ or rotateZYX, of which programs write the one that fits
# their joints, or moved by two translations, one of which has a name of its own.
# Guessed: three.js has OpenUSD's places.
# Measured on 2026-11-29 with three 0.187.0 and usd-core 26.11: for rotateXYZ it does. rotateZYX is left out, and so
# is the second translation, in silence.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install usd-core==26.11
install_npm three@0.187.0
python - <<'PYTHON'
from pathlib import Path

from pxr import Gf, Usd, UsdGeom

STAGE = """#usda 1.0
(
    defaultPrim = "mesh"
    metersPerUnit = 1
    upAxis = "Y"
)

def Mesh "mesh"
{{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(1, 2, 3), (2, 2, 3), (1, 3, 3)]
    {lines}
    uniform token[] xformOpOrder = [{order}]
}}
"""
CASES = {
    "rotateXYZ": {"float3 xformOp:rotateXYZ": "(90, 0, 90)"},
    "rotateZYX": {"float3 xformOp:rotateZYX": "(90, 0, 90)"},
    "translations": {"double3 xformOp:translate": "(10, 0, 0)", "double3 xformOp:translate:floor": "(0, 100, 0)"},
}
OPENUSD = {"rotateXYZ": [3, 1, 2], "rotateZYX": [-2, -3, 1], "translations": [11, 102, 3]}
for name, steps in CASES.items():
    order = ", ".join(f'"{step.split()[1]}"' for step in steps)
    lines = "\n    ".join(f"{step} = {value}" for step, value in steps.items())
    Path(f"{name}.usda").write_text(STAGE.format(lines=lines, order=order))
    stage = Usd.Stage.Open(f"{name}.usda")
    world = UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath("/mesh"))
    place = [round(value) for value in world.Transform(Gf.Vec3d(1, 2, 3))]
    print(name, "OpenUSD", place)
    if place != OPENUSD[name]:
        raise SystemExit("the behaviour has changed")
PYTHON
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";
import * as THREE from "three";
import { USDLoader } from "three/addons/loaders/USDLoader.js";

const EXPECTED = { rotateXYZ: [3, 1, 2], rotateZYX: [1, 2, 3], translations: [11, 2, 3] };
for (const [name, expected] of Object.entries(EXPECTED)) {
  const scene = new USDLoader().parse(readFileSync(`${name}.usda`, "utf8"));
  scene.updateMatrixWorld(true);
  scene.traverse((node) => {
    if (!node.isMesh) return;
    const point = new THREE.Vector3().fromBufferAttribute(node.geometry.attributes.position, 0);
    const place = node.localToWorld(point).toArray().map(Math.round);
    console.log(name, `three r${THREE.REVISION}`, place);
    if (String(place) !== String(expected)) {
      console.error("the behaviour has changed");
      process.exitCode = 1;
    }
  });
}
NODE
node look.mjs
