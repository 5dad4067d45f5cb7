#!/bin/sh
# Pyrr turns a hand at y = 1 by a positive angle about x: by a quaternion, by the matrix of that angle, and by the
# matrix of that quaternion, each with `turn * vector`.
# Guessed: all turn it towards +z, by the right-hand rule.
# Measured on 2026-11-29 with pyrr 0.10.3: the quaternion does, and both matrices turn it towards -z, in silence: a
# quaternion and its own matrix are opposite turns. A product of matrix and vector takes the vector for a row.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install pyrr==0.10.3 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata

from pyrr import Matrix33, Quaternion, Vector3

quaternion = Quaternion.from_x_rotation(0.5)
turns = {
    "quaternion": quaternion,
    "matrix of the angle": Matrix33.from_x_rotation(0.5),
    "matrix of the quaternion": Matrix33.from_quaternion(quaternion),
}
found = {name: round(float((turn * Vector3([0.0, 1.0, 0.0]))[2]), 3) for name, turn in turns.items()}
print(f"pyrr {importlib.metadata.version('pyrr')}: z of the hand: {found}")
if list(found.values()) != [0.479, -0.479, -0.479]:
    raise SystemExit("the behaviour has changed")
PYTHON
