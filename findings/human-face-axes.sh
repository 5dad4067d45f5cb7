#!/bin/sh
# Human and face-api, two libraries of one author, find the face of one photo of 512 px: a portrait by NASA, of
# scikit-image 0.26.0. The photo is given as it is, with pixels of half the size, and with the head leaned by 20
# degrees to the right of the picture.
# Guessed: x, y and z of the mesh double with the pixels; both state angles in radians, of equal sign. What each calls
# "left" was guessed as it is.
# Measured on 2026-11-29 with @vladmandic/human 3.3.6 and @vladmandic/face-api 1.7.15: x and y of Human's mesh double, z
# stays, in px of the network's crop, so a face is half as deep in the larger photo. Human's roll grows by .31 for the
# leaned head, in radians, face-api's falls by 21, in degrees. Human's left eye is the person's, face-api's the one at
# the left of the picture.
# Readers guessed: right, in part, in part.
. "$(dirname "$0")/common.sh"
install --no-deps scikit-image==0.26.0
install_npm @vladmandic/human@3.3.6 @vladmandic/face-api@1.7.15 @tensorflow/tfjs@4.22.0 \
    @tensorflow/tfjs-backend-wasm@4.22.0 fast-png@8.0.0
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { decode } from "fast-png";

const require = createRequire(import.meta.url);
const packages = `${process.cwd()}/node_modules`;
globalThis.fetch = async (path) => new Response(readFileSync(path.replace("file://", ""))); // Models lie on the disk.
const tf = require("@tensorflow/tfjs");
const wasmPath = `${packages}/@tensorflow/tfjs-backend-wasm/dist/`;
require("@tensorflow/tfjs-backend-wasm").setWasmPaths(wasmPath);
await tf.setBackend("wasm");
await tf.ready();
const { Human } = require(`${packages}/@vladmandic/human/dist/human.node-wasm.js`);
const faceapi = require(`${packages}/@vladmandic/face-api/dist/face-api.node-wasm.js`);

const photo = decode(readFileSync(process.argv[2]));
function view(factor, degrees) {
  const [nose, turn, side] = [[223, 130], (degrees * Math.PI) / 180, photo.width * factor];
  const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
  const pixels = new Uint8Array(side * side * 3);
  for (let row = 0; row < side; row += 1) {
    for (let column = 0; column < side; column += 1) {
      const [x, y] = [(column + 0.5) / factor - nose[0], (row + 0.5) / factor - nose[1]];
      const source = [Math.floor(nose[0] + cos * x + sin * y), Math.floor(nose[1] - sin * x + cos * y)];
      if (source.some((value) => value < 0 || value >= photo.width)) continue;
      const start = (source[1] * photo.width + source[0]) * photo.channels;
      pixels.set(photo.data.subarray(start, start + 3), (row * side + column) * 3);
    }
  }
  return tf.tensor3d(pixels, [side, side, 3], "int32");
}

const off = { enabled: false };
const human = new Human({
  backend: "wasm",
  wasmPath,
  modelBasePath: `file://${packages}/@vladmandic/human/models/`,
  cacheSensitivity: 0,
  filter: off,
  face: { emotion: off, description: off },
  body: off,
  hand: off,
  gesture: off,
});
async function withHuman(tensor) {
  const [face] = (await human.detect(tensor)).face;
  const range = (axis) => {
    const values = face.mesh.map((point) => point[axis]);
    return Math.max(...values) - Math.min(...values);
  };
  const { leftEyeLower0: left, rightEyeLower0: right } = face.annotations;
  const [width, depth, roll] = [range(0), range(2), face.rotation.angle.roll];
  return { width, depth, roll, leftEyeIsOfPicture: left[0][0] < right[0][0] };
}

await faceapi.nets.ssdMobilenetv1.loadFromDisk(`${packages}/@vladmandic/face-api/model`);
await faceapi.nets.faceLandmark68Net.loadFromDisk(`${packages}/@vladmandic/face-api/model`);
async function withFaceApi(tensor) {
  const [face] = await faceapi.detectAllFaces(tensor, new faceapi.SsdMobilenetv1Options()).withFaceLandmarks();
  const [left, right] = [face.landmarks.getLeftEye()[0], face.landmarks.getRightEye()[0]];
  return { roll: face.angle.roll, leftEyeIsOfPicture: left.x < right.x };
}

const [small, large, leaned] = [await withHuman(view(1, 0)), await withHuman(view(2, 0)), await withHuman(view(1, 20))];
const [upright, other] = [await withFaceApi(view(1, 0)), await withFaceApi(view(1, 20))];
const [wider, deeper] = [large.width / small.width, large.depth / small.depth];
const turned = [leaned.roll - small.roll, other.roll - upright.roll];
const left = [small.leftEyeIsOfPicture, upright.leftEyeIsOfPicture];
console.log(
  `Human ${human.version}, face-api ${faceapi.version}: the mesh is`,
  `${wider.toFixed(2)} times as wide, ${deeper.toFixed(2)} times as deep; roll ${turned[0].toFixed(2)} and ${turned[1]};`,
  `left is the picture's: ${left}`,
);
const near = (value, expected, tolerance) => Math.abs(value - expected) < tolerance;
const depths = near(wider, 2, 0.1) && near(deeper, 1, 0.1);
if (!(depths && near(turned[0], 0.35, 0.1) && near(turned[1], -21, 6) && !left[0] && left[1])) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
photo=$(python -c 'import importlib.util as u; print(u.find_spec("skimage").submodule_search_locations[0])')
node look.mjs "$photo/data/astronaut.png"
