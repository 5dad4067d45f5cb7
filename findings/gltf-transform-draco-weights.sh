#!/bin/sh
# A skinned body of a GLB, with four joints for each vertex, stands 5 m or 50 m from the origin, as people of photos
# do. glTF Transform compresses the file with Draco, by its defaults.
# Guessed: the body has a grid of its own, so its points move by less than .2 mm, wherever it stands.
# Measured on 2026-11-30 with @gltf-transform/functions 4.5.1 and draco3dgltf 1.5.7: a point moves by up to 1.7 mm at 5
# m, and by 16 mm at 50 m. Each weight is rounded to 12 bits, so those of a vertex add up to as much as 1.0003, where
# glTF asks for 1, and the vertex is scaled away from the origin. Readers that divide by the sum undo it.
. "$(dirname "$0")/common.sh"
install_npm @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 @gltf-transform/functions@4.5.1 \
    draco3dgltf@1.5.7
cat > compress.mjs <<'NODE'
import { readFileSync } from "node:fs";
import { Document, NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { draco } from "@gltf-transform/functions";
import draco3d from "draco3dgltf";

const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
  "draco3d.decoder": await draco3d.createDecoderModule(),
  "draco3d.encoder": await draco3d.createEncoderModule(),
});
const ROWS = 40;

// A tube of 1.7 m at a distance (x = .6, z = -.8 of it), bound where it stands, so that posed points are its points.
function body(distance) {
  const document = new Document();
  const buffer = document.createBuffer();
  const add = (array, type) => document.createAccessor().setArray(array).setType(type).setBuffer(buffer);
  const [points, weights, joints, faces] = [[], [], [], []];
  for (let row = 0; row < ROWS; row += 1) {
    for (let column = 0; column < ROWS; column += 1) {
      const turn = (2 * Math.PI * column) / ROWS;
      const [x, z] = [0.6 * distance + 0.2 * Math.cos(turn), -0.8 * distance + 0.2 * Math.sin(turn)];
      points.push(x, (1.7 * row) / (ROWS - 1), z);
      const shares = [1, 2, 3, 5].map((factor) => 1 + Math.sin(factor * (0.37 * row + 0.11 * column) + factor));
      const sum = shares.reduce((one, other) => one + other);
      weights.push(...shares.map((share) => share / sum));
      joints.push(0, 1, 2, 3);
      const [own, next] = [ROWS * row + column, ROWS * row + ((column + 1) % ROWS)];
      if (row < ROWS - 1) faces.push(own, next, own + ROWS, next, next + ROWS, own + ROWS);
    }
  }
  const primitive = document
    .createPrimitive()
    .setIndices(add(new Uint32Array(faces), "SCALAR"))
    .setAttribute("POSITION", add(new Float32Array(points), "VEC3"))
    .setAttribute("JOINTS_0", add(new Uint8Array(joints), "VEC4"))
    .setAttribute("WEIGHTS_0", add(new Float32Array(weights), "VEC4"));
  const place = [0.6 * distance, 0.8, -0.8 * distance];
  const nodes = ["pelvis", "spine1", "spine2", "spine3"].map((name) => document.createNode(name));
  nodes.slice(1).forEach((node, above) => nodes[above].addChild(node));
  nodes[0].setTranslation(place);
  const unplaced = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -place[0], -place[1], -place[2], 1];
  const skin = nodes.reduce((made, node) => made.addJoint(node), document.createSkin());
  skin.setInverseBindMatrices(add(new Float32Array(nodes.flatMap(() => unplaced)), "MAT4"));
  const node = document.createNode("body").setMesh(document.createMesh("body").addPrimitive(primitive)).setSkin(skin);
  document.createScene().addChild(node).addChild(nodes[0]);
  return document;
}

// Posed points, by the sum over the joints that glTF states; all joints leave points where they are.
function posed(document) {
  const primitive = document.getRoot().listMeshes()[0].listPrimitives()[0];
  const [places, weights] = ["POSITION", "WEIGHTS_0"].map((name) => primitive.getAttribute(name));
  return Array.from({ length: places.getCount() }, (_, vertex) => {
    const sum = weights.getElement(vertex, []).reduce((one, other) => one + other);
    return { sum, point: places.getElement(vertex, []).map((value) => value * sum) };
  });
}

async function worst(distance) {
  const own = posed(body(distance));
  const document = body(distance);
  await document.transform(draco());
  await io.write("body.glb", document);
  const found = posed(await io.read("body.glb"));
  const nearest = ({ point }) =>
    Math.min(...own.map((one) => Math.hypot(...one.point.map((value, axis) => value - point[axis]))));
  return { mm: 1000 * Math.max(...found.map(nearest)), sum: Math.max(...found.map(({ sum }) => sum)) };
}

const version = (name) => JSON.parse(readFileSync(`node_modules/${name}/package.json`)).version;
const [near, far] = [await worst(5), await worst(50)];
console.log(
  `@gltf-transform/functions ${version("@gltf-transform/functions")}, draco3dgltf ${version("draco3dgltf")}:`,
  `${near.mm.toFixed(1)} mm at 5 m, ${far.mm.toFixed(1)} mm at 50 m; weights add up to ${far.sum.toFixed(4)}`,
);
if (!(near.mm > 1.2 && near.mm < 2.4 && far.mm > 12 && far.mm < 20 && far.sum > 1.0001 && far.sum < 1.001)) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node compress.mjs
