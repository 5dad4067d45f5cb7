#!/bin/sh
# The Hausdorff distance from a mesh to another is the largest distance of its points. The first mesh has a ball at
# the place of the second, and a small ball 10 m away.
# Guessed: MeshLab's filter reports about 9 m, with its defaults.
# Measured on 2026-11-28 with pymeshlab 2025.7.post1: 0 m. What lies farther off than half of a diagonal is left out
# in silence; only the number of samples tells. With a small ball alone, it reports 0 m of no samples.
. "$(dirname "$0")/common.sh"
install pymeshlab==2025.7.post1 trimesh==5.2.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import pymeshlab
import trimesh

ball = trimesh.creation.icosphere(3)
far = trimesh.creation.icosphere(2, radius=0.2)
far.apply_translation((0, 0, 10))
both = trimesh.util.concatenate([ball, far])
found = {}
for name, mesh in {"ball": ball, "both": both, "far": far}.items():
    scene = pymeshlab.MeshSet()
    scene.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    scene.add_mesh(pymeshlab.Mesh(ball.vertices, ball.faces))
    distances = scene.get_hausdorff_distance(sampledmesh=0, targetmesh=1)
    found[name] = (round(distances["max"], 3), distances["n_samples"], len(mesh.vertices))
version = importlib.metadata.version("pymeshlab")
print(f"pymeshlab {version}: largest distance, samples, vertices: {found}")
largest, samples, _ = found["both"]
if not (largest == 0 and samples <= len(ball.vertices) and found["far"][:2] == (0, 0)):
    raise SystemExit("the behaviour has changed")
PYTHON
