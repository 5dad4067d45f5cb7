#!/bin/sh
# A glTF mesh has normals, an unlit material, and a variant of it (KHR_materials_variants) with a lit material. glTF
# Transform's `prune` removes attributes that no material needs.
# Guessed: the lit variant keeps its normals.
# Measured on 2026-11-28 with @gltf-transform/cli 4.5.1: NORMAL is removed, the variant stays. `--keep-attributes
# true` keeps it.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install_npm @gltf-transform/cli@4.5.1
cat > make.mjs <<'NODE'
import { writeFileSync } from "node:fs";

const points = [0, 0, 0, 1, 0, 0, 0, 1, 0];
const normals = [0, 0, 1, 0, 0, 1, 0, 0, 1];
const data = Buffer.from(new Float32Array([...points, ...normals]).buffer);
const accessor = { componentType: 5126, count: 3, type: "VEC3" };
const mappings = [
  { material: 0, variants: [0] },
  { material: 1, variants: [1] },
];
const primitive = {
  attributes: { POSITION: 0, NORMAL: 1 },
  material: 0,
  extensions: { KHR_materials_variants: { mappings } },
};
const document = {
  asset: { version: "2.0" },
  extensionsUsed: ["KHR_materials_unlit", "KHR_materials_variants"],
  extensions: { KHR_materials_variants: { variants: [{ name: "photo" }, { name: "lit" }] } },
  scene: 0,
  scenes: [{ nodes: [0] }],
  nodes: [{ mesh: 0 }],
  meshes: [{ primitives: [primitive] }],
  materials: [{ extensions: { KHR_materials_unlit: {} } }, { name: "lit" }],
  accessors: [
    { ...accessor, bufferView: 0, min: [0, 0, 0], max: [1, 1, 0] },
    { ...accessor, bufferView: 1 },
  ],
  bufferViews: [
    { buffer: 0, byteOffset: 0, byteLength: 36 },
    { buffer: 0, byteOffset: 36, byteLength: 36 },
  ],
  buffers: [{ byteLength: 72, uri: `data:application/octet-stream;base64,${data.toString("base64")}` }],
};
writeFileSync("in.gltf", JSON.stringify(document));
NODE
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";

const kept = {};
for (const name of ["pruned", "kept"]) {
  const document = JSON.parse(readFileSync(`${name}.gltf`, "utf8"));
  const primitive = document.meshes[0].primitives[0];
  const variants = primitive.extensions.KHR_materials_variants.mappings.length;
  kept[name] = `${Object.keys(primitive.attributes).sort().join(", ")}; ${variants} variants`;
}
console.log("@gltf-transform/cli 4.5.1:", JSON.stringify(kept));
const expected = { pruned: "POSITION; 2 variants", kept: "NORMAL, POSITION; 2 variants" };
if (JSON.stringify(kept) !== JSON.stringify(expected)) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node make.mjs
npx gltf-transform prune in.gltf pruned.gltf > prune.log 2>&1
npx gltf-transform prune in.gltf kept.gltf --keep-attributes true > kept.log 2>&1
node look.mjs
