#!/bin/sh
# The root of a BVH file has an OFFSET of 1 m in height, and channels of position that say 1 m, too, as many exporters
# write it.
# Guessed: three.js puts the root 1 m high, since a position replaces the OFFSET, as Blender and bvhio have it.
# Measured on 2026-11-28 with three 0.187.0 and bvhio 1.5.4: three.js adds both, so the person floats 1 m above the
# floor (root at 2 m); bvhio has 1 m.
# Readers guessed: in part, in part, right.
. "$(dirname "$0")/common.sh"
install bvhio==1.5.4 pyglm==2.8.2 spatial-transform==1.3.3 \
    numpy==2.4.6
install_npm three@0.187.0
cat > body.bvh <<'BVH'
HIERARCHY
ROOT Hips
{
	OFFSET 0 1 0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Knee
	{
		OFFSET 0 -0.5 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0 -0.5 0
		}
	}
}
MOTION
Frames: 2
Frame Time: 0.04
0 1 0 0 0 0 0 0 0
0 1 0 0 0 0 0 0 0
BVH
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";
import { AnimationMixer, REVISION, Vector3 } from "three";
import { BVHLoader } from "three/examples/jsm/loaders/BVHLoader.js";

const { skeleton, clip } = new BVHLoader().parse(readFileSync("body.bvh", "utf8"));
const root = skeleton.bones[0];
const mixer = new AnimationMixer(root);
mixer.clipAction(clip).play();
mixer.update(0.01);
root.updateMatrixWorld(true);
const height = new Vector3().setFromMatrixPosition(root.matrixWorld).y;
console.log(`three ${REVISION}: the root is at ${height.toFixed(2)} m`);
if (Math.abs(height - 2) > 1e-5) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
python - <<'PYTHON'
import importlib.metadata

import bvhio

skeleton = bvhio.readAsHierarchy("body.bvh")
skeleton.loadPose(0)
height = skeleton.PositionWorld[1]
print(f"bvhio {importlib.metadata.version('bvhio')}: the root is at {height:.2f} m")
if abs(height - 1) > 1e-5:
    raise SystemExit("the behaviour has changed")
PYTHON
