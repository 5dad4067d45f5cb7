#!/bin/sh
# An FBX file has two skeletons whose joints have the same names, each with an animation of its own: person_0 moves to
# x = 2, person_1 to x = 8. three.js loads the file and plays both.
# Guessed: each skeleton does its own motion, as in Blender and FBX2glTF.
# Measured on 2026-11-28 with three 0.187.0: animations find joints by their names, and both are those of the first
# skeleton: it does the mean of both motions (x = 5), and the second stays as it was. It says nothing.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install_npm three@0.187.0
cat > look.mjs <<'NODE'
import { AnimationMixer, REVISION, Vector3 } from "three";
import { FBXLoader } from "three/addons/loaders/FBXLoader.js";

globalThis.window = globalThis;
const SECOND = 46186158000;
const objects = [];
const links = [];
const object = (type, id, name, kind, lines) =>
  objects.push([`\t${type}: ${id}, "${name}", "${kind}" {`, ...lines.map((line) => `\t\t${line}`), "\t}"].join("\n"));
for (const person of [0, 1]) {
  const id = 1000 * (person + 1);
  const goal = [2, 8][person];
  object("Model", id, `Model::person_${person}`, "Null", ["Version: 232"]);
  object("NodeAttribute", id + 7, "NodeAttribute::pelvis", "LimbNode", ['TypeFlags: "Skeleton"']);
  object("Model", id + 1, "Model::pelvis", "LimbNode", ["Version: 232"]);
  object("AnimationStack", id + 2, `AnimStack::person_${person}_walks`, "", ["Version: 100"]);
  object("AnimationLayer", id + 3, `AnimLayer::person_${person}`, "", ["Version: 100"]);
  object("AnimationCurveNode", id + 4, "AnimCurveNode::T", "", ["Version: 100"]);
  links.push(`"OO",${id},0`, `"OO",${id + 1},${id}`, `"OO",${id + 7},${id + 1}`);
  links.push(`"OO",${id + 3},${id + 2}`, `"OO",${id + 4},${id + 3}`, `"OP",${id + 4},${id + 1}, "Lcl Translation"`);
  for (const [number, axis] of ["X", "Y", "Z"].entries()) {
    const curve = id + 10 + number;
    const values = axis === "X" ? `0,${goal}` : "0,0";
    const keys = ["KeyTime: *2 {", `\ta: 0,${SECOND}`, "}", "KeyValueFloat: *2 {", `\ta: ${values}`, "}"];
    object("AnimationCurve", curve, "AnimCurve::", "", keys);
    links.push(`"OP",${curve},${id + 4}, "d|${axis}"`);
  }
}
const head = "; FBX 7.4.0 project file\nFBXHeaderExtension:  {\n\tFBXHeaderVersion: 1003\n\tFBXVersion: 7400\n}\n";
const joined = links.map((link) => `\t;\n\tC: ${link}`).join("\n");
const text = `${head}Objects:  {\n${objects.join("\n")}\n}\nConnections:  {\n${joined}\n}\n`;
const scene = new FBXLoader().parse(new TextEncoder().encode(text).buffer, "");
const mixer = new AnimationMixer(scene);
for (const clip of scene.animations) mixer.clipAction(clip).play();
mixer.setTime(0.999999);
scene.updateMatrixWorld(true);
const places = [0, 1].map((person) => {
  const joint = scene.getObjectByName(`person_${person}`).children[0];
  return [joint.name, +joint.getWorldPosition(new Vector3()).x.toFixed(3)];
});
console.log(`three ${REVISION}: ${scene.animations.length} animations, x of joints: ${JSON.stringify(places)}`);
if (JSON.stringify(places.map(([, x]) => x)) !== "[5,0]") {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
