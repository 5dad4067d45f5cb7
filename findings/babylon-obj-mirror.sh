#!/bin/sh
# Babylon.js loads a glTF with a hand at x = 2, and writes what it loaded as OBJ, each with its defaults.
# Guessed: the hand is at x = 2, as both formats are right-handed.
# Measured on 2026-11-29 with @babylonjs/core 9.35.0, loaders and serializers 9.28.0: the hand is at x = -2: a left
# hand has become a right one. A scene is left-handed by default, so the loader mirrors what it loads at a root node.
# OBJExport.OBJ mirrors it back, but leaves that node out, unless its fourth argument (globalposition) is true.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install_npm @babylonjs/core@9.35.0 @babylonjs/loaders@9.28.0 \
    @babylonjs/serializers@9.28.0
cat > look.mjs <<'NODE'
import { Engine, ImportMeshAsync, NullEngine, Scene } from "@babylonjs/core";
import "@babylonjs/loaders/glTF/index.js";
import { OBJExport } from "@babylonjs/serializers";

globalThis.XMLHttpRequest ??= class {}; // The loader asks whether there is one, and reads the document without it.
const bytes = Buffer.concat([
  Buffer.from(new Float32Array([0, 0, 0, 2, 0, 0, 0, 1, 0.5]).buffer),
  Buffer.from(new Uint16Array([0, 1, 2, 0]).buffer),
]);
const gltf = {
  asset: { version: "2.0" },
  scene: 0,
  scenes: [{ nodes: [0] }],
  nodes: [{ mesh: 0, name: "body" }],
  meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
  accessors: [
    { bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [2, 1, 0.5] },
    { bufferView: 1, componentType: 5123, count: 3, type: "SCALAR" },
  ],
  bufferViews: [
    { buffer: 0, byteLength: 36 },
    { buffer: 0, byteOffset: 36, byteLength: 6 },
  ],
  buffers: [{ byteLength: 44, uri: `data:application/octet-stream;base64,${bytes.toString("base64")}` }],
};
const scene = new Scene(new NullEngine());
await ImportMeshAsync(`data:${JSON.stringify(gltf)}`, scene, { pluginExtension: ".gltf" });
const meshes = scene.meshes.filter((mesh) => mesh.getTotalVertices() > 0);
for (const mesh of meshes) mesh.computeWorldMatrix(true);
const points = (text) => text.match(/^v .*/gm).map((line) => line.split(" ").slice(1).map(Number));
const [plain, global] = [OBJExport.OBJ(meshes), OBJExport.OBJ(meshes, false, "", true)].map(points);
console.log(`Babylon.js ${Engine.Version}: by default`, plain, "with globalposition", global);
const text = JSON.stringify;
if (text(plain) !== "[[0,0,0],[-2,0,0],[0,1,0.5]]" || text(global) !== "[[0,0,0],[2,0,0],[0,1,0.5]]") {
  console.log("the behaviour has changed");
  process.exit(1);
}
process.exit(0);
NODE
node look.mjs
