#!/bin/sh
# A USD stage has a body, a collider of purpose "guide", which viewers do not draw, and a mesh with visibility
# "invisible".
# Guessed: three.js shows the body alone, as OpenUSD's default asks for.
# Measured on 2026-11-29 with three 0.187.0: it shows all three, in silence.
# Readers guessed: right, in part, right.
. "$(dirname "$0")/common.sh"
install_npm three@0.187.0
cat > look.mjs <<'NODE'
import * as THREE from "three";
import { USDLoader } from "three/addons/loaders/USDLoader.js";

const mesh = (name, line) => `    def Mesh "${name}"
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
${line}
    }
`;
const stage = `#usda 1.0
(
    defaultPrim = "root"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "root"
{
${mesh("body", "")}
${mesh("collider", '        uniform token purpose = "guide"')}
${mesh("hidden", '        token visibility = "invisible"')}
}
`;
const shown = [];
new USDLoader().parse(stage).traverseVisible((node) => {
  if (node.isMesh) shown.push(node.name);
});
console.log(`three r${THREE.REVISION} shows`, shown);
if (String(shown) !== "body,collider,hidden") {
  console.error("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
