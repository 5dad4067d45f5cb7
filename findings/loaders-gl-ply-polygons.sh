#!/bin/sh
# A PLY mesh has a triangle, a quad and a pentagon, as meshes of modelling programs do. loaders.gl reads it.
# Guessed: six triangles, in a fan of each polygon.
# Measured on 2026-11-29 with @loaders.gl/ply 4.4.5: three: the pentagon is left out, in silence. A mesh of pentagons
# alone comes back as points (point-list), without an index.
. "$(dirname "$0")/common.sh"
install_npm @loaders.gl/core@4.4.2 @loaders.gl/ply@4.4.5 \
    @math.gl/types@4.1.0
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";
import { parse } from "@loaders.gl/core";
import { PLYLoader } from "@loaders.gl/ply";

async function triangles(faces) {
  const text =
    "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n" +
    `element face ${faces.length}\nproperty list uchar int vertex_indices\nend_header\n` +
    "0 0 0\n1 0 0\n1 1 0\n0.5 1.5 0\n0 1 0\n" +
    faces.map((face) => `${face.length} ${face.join(" ")}\n`).join("");
  const mesh = await parse(new Uint8Array(Buffer.from(text)).buffer, PLYLoader, { worker: false });
  return `${(mesh.indices?.value.length ?? 0) / 3} ${mesh.topology}`;
}

const mixed = await triangles([[0, 1, 2], [0, 1, 2, 4], [0, 1, 2, 3, 4]]);
const pentagon = await triangles([[0, 1, 2, 3, 4]]);
const { version } = JSON.parse(readFileSync("node_modules/@loaders.gl/ply/package.json", "utf8"));
console.log(`@loaders.gl/ply ${version}: triangle, quad and pentagon: ${mixed}; pentagon alone: ${pentagon}`);
if (mixed !== "3 triangle-list" || pentagon !== "0 point-list") {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
