#!/bin/sh
# A skinned mesh of three.js is posed: its one bone stands 5 m aside, and so does what is seen. Four exporters write
# the scene.
# Guessed: all write the pose, or refuse a skin that the format does not have.
# Measured on 2026-11-29 with three 0.187.0: STLExporter alone writes the pose. OBJExporter, PLYExporter and
# USDZExporter write the mesh as it was bound, at 0, without a warning; USDZ has no skeleton either, though the format
# has them.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install_npm three@0.187.0
cat > look.mjs <<'NODE'
import * as THREE from "three";
import { OBJExporter } from "three/examples/jsm/exporters/OBJExporter.js";
import { PLYExporter } from "three/examples/jsm/exporters/PLYExporter.js";
import { STLExporter } from "three/examples/jsm/exporters/STLExporter.js";
import { USDZExporter } from "three/examples/jsm/exporters/USDZExporter.js";

globalThis.requestAnimationFrame = setImmediate; // PLYExporter hands its text over in a frame of a browser.
const geometry = new THREE.BufferGeometry();
geometry.setAttribute("position", new THREE.Float32BufferAttribute([0, 0, 0, 1, 0, 0, 0, 1, 0], 3));
geometry.setAttribute("normal", new THREE.Float32BufferAttribute([0, 0, 1, 0, 0, 1, 0, 0, 1], 3));
geometry.setAttribute("skinIndex", new THREE.Uint16BufferAttribute(new Array(12).fill(0), 4));
geometry.setAttribute("skinWeight", new THREE.Float32BufferAttribute([1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0], 4));
geometry.setIndex([0, 1, 2]);
const mesh = new THREE.SkinnedMesh(geometry, new THREE.MeshStandardMaterial());
const bone = new THREE.Bone();
mesh.add(bone);
mesh.bind(new THREE.Skeleton([bone]));
bone.position.x = 5;
const scene = new THREE.Scene();
scene.add(mesh);
scene.updateMatrixWorld(true);

const number = (text, pattern) => Number(text.match(pattern)[1]);
const usdz = Buffer.from(await new USDZExporter().parseAsync(scene)).toString("latin1");
const ply = await new Promise((done) => new PLYExporter().parse(scene, done));
const first = {
  seen: mesh.applyBoneTransform(0, new THREE.Vector3(0, 0, 0)).x,
  STL: number(new STLExporter().parse(scene), /vertex (\S+)/),
  OBJ: number(new OBJExporter().parse(scene), /^v (\S+)/m),
  PLY: number(ply, /end_header\s+(\S+)/),
  USDZ: number(usdz, /point3f\[\] points = \[\(([^,]+)/),
};
const skeleton = usdz.includes("Skel");
console.log(`three ${THREE.REVISION}: x of the first vertex`, first, `skeleton in USDZ: ${skeleton}`);
if (first.seen !== 5 || first.STL !== 5 || first.OBJ !== 0 || first.PLY !== 0 || first.USDZ !== 0 || skeleton) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
