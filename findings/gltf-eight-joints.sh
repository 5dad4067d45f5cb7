#!/bin/sh
# A vertex of a valid glTF hangs on eight joints (JOINTS_1 and WEIGHTS_1), as those of faces and of bodies like SMPL-X
# do: .05 for each of four that stay, .2 for each of four that move by 8 m, so it moves by 6.4 m.
# Guessed: viewers that take four joints take the largest weights; a converter keeps eight, or says that it does not.
# Measured on 2026-11-29: three 0.187.0 takes the first four, so the vertex stays at 0. gltfpack 1.3.0 keeps the four
# largest: 8 m. assimpjs 0.0.10 reads eight, and writes the four largest as they are, so that the weights add up to
# .8, where glTF asks for 1. All do it in silence. Babylon.js 9.35.0 has 6.4 m.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install_npm three@0.187.0 @babylonjs/core@9.35.0 @babylonjs/loaders@9.28.0 gltfpack@1.3.0 assimpjs@0.0.10
cat > look.mjs <<'NODE'
import { execFileSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";
import { ImportMeshAsync, NullEngine, Scene } from "@babylonjs/core";
import "@babylonjs/loaders/glTF/index.js";
import assimpjs from "assimpjs";
import { Vector3 } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

globalThis.XMLHttpRequest ??= class {}; // Both loaders ask whether there is one.
globalThis.self ??= globalThis;
globalThis.ProgressEvent ??= class {};
const repeat = (row) => [...row, ...row, ...row];
const joints = Array.from({ length: 8 }, (_, number) => number + 2);
const eye = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const arrays = [
  [new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]), 5126, "VEC3", 3],
  [new Uint8Array(repeat([0, 1, 2, 3])), 5121, "VEC4", 3],
  [new Float32Array(repeat([0.05, 0.05, 0.05, 0.05])), 5126, "VEC4", 3],
  [new Uint8Array(repeat([4, 5, 6, 7])), 5121, "VEC4", 3],
  [new Float32Array(repeat([0.2, 0.2, 0.2, 0.2])), 5126, "VEC4", 3],
  [new Float32Array(joints.flatMap(() => eye)), 5126, "MAT4", 8],
  [new Uint16Array([0, 1, 2, 0]), 5123, "SCALAR", 3],
];
const buffers = arrays.map(([values]) => Buffer.from(values.buffer));
let start = 0;
const bufferViews = buffers.map(({ length: byteLength }) => {
  start += byteLength;
  return { buffer: 0, byteOffset: start - byteLength, byteLength };
});
const accessors = arrays.map(([, componentType, type, count], bufferView) => {
  return { bufferView, componentType, type, count };
});
Object.assign(accessors[0], { min: [0, 0, 0], max: [1, 1, 0] });
const attributes = { POSITION: 0, JOINTS_0: 1, WEIGHTS_0: 2, JOINTS_1: 3, WEIGHTS_1: 4 };
const data = Buffer.concat(buffers).toString("base64");
const text = JSON.stringify({
  asset: { version: "2.0" },
  scene: 0,
  scenes: [{ nodes: [0, 1] }],
  nodes: [
    { name: "body", mesh: 0, skin: 0 },
    { name: "root", children: joints },
    ...joints.map((number) => ({ name: `joint${number}`, translation: [number < 6 ? 0 : 8, 0, 0] })),
  ],
  skins: [{ joints, inverseBindMatrices: 5 }],
  meshes: [{ primitives: [{ attributes, indices: 6 }] }],
  accessors,
  bufferViews,
  buffers: [{ byteLength: start, uri: `data:application/octet-stream;base64,${data}` }],
});
writeFileSync("body.gltf", text);

async function withThree(document) {
  const { scene } = await new GLTFLoader().parseAsync(document, "");
  scene.updateMatrixWorld(true);
  let place;
  scene.traverse((node) => {
    if (node.isSkinnedMesh) place = node.getVertexPosition(0, new Vector3()).applyMatrix4(node.matrixWorld).x;
  });
  return Math.round(place * 10) / 10;
}

async function withBabylon() {
  const scene = new Scene(new NullEngine());
  await ImportMeshAsync(`data:${text}`, scene, { pluginExtension: ".gltf" });
  scene.skeletons[0].prepare(true);
  const mesh = scene.meshes.find((one) => one.getTotalVertices() > 0);
  return Math.round(Math.abs(mesh.getPositionData(true, true)[0]) * 10) / 10; // The scene is left-handed.
}

async function assimpWeights() {
  const assimp = await assimpjs();
  const files = new assimp.FileList();
  files.AddFile("body.gltf", new Uint8Array(Buffer.from(text)));
  const bytes = Buffer.from(assimp.ConvertFileList(files, "glb2").GetFile(0).GetContent());
  const length = bytes.readUInt32LE(12);
  const written = JSON.parse(bytes.subarray(20, 20 + length));
  const names = written.meshes[0].primitives[0].attributes;
  const view = written.bufferViews[written.accessors[names.WEIGHTS_0].bufferView];
  const begin = 28 + length + (view.byteOffset ?? 0);
  const sum = [0, 4, 8, 12].reduce((total, offset) => total + bytes.readFloatLE(begin + offset), 0);
  return [Math.round(sum * 100) / 100, "JOINTS_1" in names];
}

execFileSync("npx", ["gltfpack", "-i", "body.gltf", "-o", "packed.gltf", "-noq"], { stdio: "ignore" });
const packed = JSON.parse(readFileSync("packed.gltf", "utf8"));
const bin = readFileSync("packed.bin").toString("base64");
packed.buffers[0].uri = `data:application/octet-stream;base64,${bin}`;
delete packed.buffers[1];
const viewers = [await withThree(text), await withThree(JSON.stringify(packed)), await withBabylon()];
const found = [...viewers, await assimpWeights()];
console.log("three 0.187.0, gltfpack 1.3.0, Babylon.js: x in m; assimpjs: sum of weights:", JSON.stringify(found));
const expected = JSON.stringify([0, 8, 6.4, [0.8, false]]);
if (JSON.stringify(found) !== expected) {
  console.log("the behaviour has changed");
  process.exit(1);
}
process.exit(0);
NODE
node look.mjs
