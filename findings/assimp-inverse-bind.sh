#!/bin/sh
# A skin of a glTF leaves `inverseBindMatrices` out, which are identity then, by the specification.
# Guessed: readers read it like the file that states them.
# Measured on 2026-11-29 with assimpjs 0.0.10 and three 0.187.0: assimp refuses the file ("import_error"), and reads
# the one that states them. three.js reads both alike.
. "$(dirname "$0")/common.sh"
install_npm assimpjs@0.0.10 three@0.187.0
cat > look.mjs <<'NODE'
import assimpjs from "assimpjs";
import { Vector3 } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

globalThis.self ??= globalThis; // The loader asks for both.
globalThis.ProgressEvent ??= class {};
const eye = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const arrays = [
  [new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]), 5126, "VEC3", 3],
  [new Uint8Array(12), 5121, "VEC4", 3],
  [new Float32Array([1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]), 5126, "VEC4", 3],
  [new Float32Array(eye), 5126, "MAT4", 1],
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
const data = Buffer.concat(buffers).toString("base64");
const document = (skin) => JSON.stringify({
  asset: { version: "2.0" },
  scene: 0,
  scenes: [{ nodes: [0, 1] }],
  nodes: [{ name: "body", mesh: 0, skin: 0 }, { name: "hip", translation: [2, 0, 0] }],
  skins: [skin],
  meshes: [{ primitives: [{ attributes: { POSITION: 0, JOINTS_0: 1, WEIGHTS_0: 2 }, indices: 4 }] }],
  accessors,
  bufferViews,
  buffers: [{ byteLength: start, uri: `data:application/octet-stream;base64,${data}` }],
});

const assimp = await assimpjs();
function withAssimp(text) {
  const files = new assimp.FileList();
  files.AddFile("body.gltf", new Uint8Array(Buffer.from(text)));
  const result = assimp.ConvertFileList(files, "assjson");
  return result.IsSuccess() ? "read" : result.GetErrorCode();
}
async function withThree(text) {
  const { scene } = await new GLTFLoader().parseAsync(text, "");
  scene.updateMatrixWorld(true);
  const mesh = scene.getObjectByName("body");
  return mesh.getVertexPosition(0, new Vector3()).applyMatrix4(mesh.matrixWorld).x;
}
const [stated, left] = [document({ joints: [1], inverseBindMatrices: 3 }), document({ joints: [1] })];
const found = [withAssimp(stated), withAssimp(left), await withThree(stated), await withThree(left)];
console.log("assimpjs 0.0.10, with matrices and without:", found[0], found[1], "three.js:", found[2], found[3]);
if (JSON.stringify(found) !== JSON.stringify(["read", "import_error", 2, 2])) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
