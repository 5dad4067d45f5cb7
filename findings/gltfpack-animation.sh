#!/bin/sh
# A node of a GLB moves by 1 m from 0 s to 1/24 s, and stays. gltfpack makes the file smaller.
# Guessed: the node is where it was at each time of the file, to .1 mm.
# Measured on 2026-11-28 with gltfpack 1.3: it samples animations at 30 Hz, so at 1/24 s the node is .15 m short of
# its place, and the last key is at 1/15 s. `-af 0` keeps the keys. No switch keeps attributes of vertices whose names
# begin with _.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install_npm gltfpack@1.3.0
cat > make.mjs <<'NODE'
import { writeFileSync } from "node:fs";

const points = [0, 0, 0, 1, 0, 0, 0, 1, 0];
const times = [0, 1 / 24];
const places = [0, 0, 0, 1, 0, 0];
const data = Buffer.from(new Float32Array([...points, ...times, ...places, 0, 1, 1]).buffer);
const view = (byteOffset, byteLength) => ({ buffer: 0, byteOffset, byteLength });
const document = {
  asset: { version: "2.0" },
  scene: 0,
  scenes: [{ nodes: [0], extras: { units: "metres" } }],
  nodes: [{ name: "pelvis", mesh: 0 }],
  meshes: [{ primitives: [{ attributes: { POSITION: 0, _CONTACT: 3 } }] }],
  animations: [
    {
      name: "pose",
      samplers: [{ input: 1, output: 2 }],
      channels: [{ sampler: 0, target: { node: 0, path: "translation" } }],
    },
  ],
  accessors: [
    { bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] },
    { bufferView: 1, componentType: 5126, count: 2, type: "SCALAR", min: [0], max: [1 / 24] },
    { bufferView: 2, componentType: 5126, count: 2, type: "VEC3" },
    { bufferView: 3, componentType: 5126, count: 3, type: "SCALAR" },
  ],
  bufferViews: [view(0, 36), view(36, 8), view(44, 24), view(68, 12)],
  buffers: [{ byteLength: 80, uri: `data:application/octet-stream;base64,${data.toString("base64")}` }],
};
writeFileSync("in.gltf", JSON.stringify(document));
NODE
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";

const found = {};
for (const name of ["packed", "kept"]) {
  const document = JSON.parse(readFileSync(`${name}.gltf`, "utf8"));
  const data = readFileSync(document.buffers[0].uri);
  const numbers = (index) => {
    const accessor = document.accessors[index];
    const start = (document.bufferViews[accessor.bufferView].byteOffset ?? 0) + (accessor.byteOffset ?? 0);
    const size = accessor.type === "VEC3" ? 3 : 1;
    return Array.from({ length: accessor.count * size }, (_, i) => data.readFloatLE(start + 4 * i));
  };
  const sampler = document.animations[0].samplers[0];
  const times = numbers(sampler.input);
  const xs = numbers(sampler.output).filter((_, i) => i % 3 === 0);
  const next = times.findIndex((time) => time >= 1 / 24 - 1e-6);
  const share = (1 / 24 - times[next - 1]) / (times[next] - times[next - 1]);
  const x = xs[next - 1] + share * (xs[next] - xs[next - 1]);
  const contact = "_CONTACT" in document.meshes[0].primitives[0].attributes;
  found[name] = { times: times.map((time) => +time.toFixed(4)), x: +x.toFixed(3), contact };
}
console.log("gltfpack 1.3.0:", JSON.stringify(found));
const short = found.packed.times.length === 3 && Math.abs(found.packed.x - 0.85) < 0.01;
if (!(short && found.kept.x === 1 && !found.packed.contact && !found.kept.contact)) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node make.mjs
npx gltfpack -i in.gltf -o packed.gltf -noq > packed.log 2>&1
npx gltfpack -i in.gltf -o kept.gltf -noq -kn -kv -ke -af 0 > kept.log 2>&1
node look.mjs
