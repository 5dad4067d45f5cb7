#!/bin/sh
# A person of 1.7 m stands in a T-pose, as a BVH with the 55 joints of SMPL-X, of which 30 are fingers. Where is the
# centre of mass?
# Guessed: by segment masses, within 3 cm of a table of anatomy.
# Measured on 2026-11-30 with pybvh 0.9.0: 1.24 m high, 22 cm above the table's 1.02 m: by default each node counts the
# same, as its documentation says, so that the hands weigh more than all the rest. Without fingers it is 1.05 m.
. "$(dirname "$0")/common.sh"
install pybvh==0.9.0 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pybvh

PLACES = {
    "pelvis": (None, (0, 0.93)), "spine1": ("pelvis", (0, 1.05)), "spine2": ("spine1", (0, 1.17)),
    "spine3": ("spine2", (0, 1.23)), "neck": ("spine3", (0, 1.42)), "head": ("neck", (0, 1.52)),
    "jaw": ("head", (0, 1.5)),
}  # fmt: skip
for side, x in (("left", 1), ("right", -1)):
    for name, parent, place in (
        ("hip", "pelvis", (0.06, 0.88)), ("knee", "hip", (0.1, 0.48)), ("ankle", "knee", (0.1, 0.08)),
        ("foot", "ankle", (0.1, 0.02)), ("collar", "spine3", (0.06, 1.38)), ("eye", "head", (0.03, 1.6)),
        ("shoulder", "collar", (0.18, 1.4)), ("elbow", "shoulder", (0.45, 1.4)), ("wrist", "elbow", (0.69, 1.4)),
    ):  # fmt: skip
        above = parent if parent in PLACES else f"{side}_{parent}"
        PLACES[f"{side}_{name}"] = above, (x * place[0], place[1])
FINGERS = {}
for side, x in (("left", 1), ("right", -1)):
    for finger in ("index", "middle", "pinky", "ring", "thumb"):
        for number in (1, 2, 3):
            above = f"{side}_wrist" if number == 1 else f"{side}_{finger}{number - 1}"
            FINGERS[f"{side}_{finger}{number}"] = above, (x * (0.75 + 0.03 * number), 1.4)
# Dempster, in table 4.1 of D. A. Winter, Biomechanics and Motor Control of Human Movement: shares of mass and way
MASSES = (
    ("pelvis", "neck", 0.497, 0.5), ("neck", "head", 0.081, 1.0), ("hip", "knee", 0.1, 0.433),
    ("knee", "ankle", 0.0465, 0.433), ("ankle", "foot", 0.0145, 0.5), ("shoulder", "elbow", 0.028, 0.436),
    ("elbow", "wrist", 0.016, 0.43), ("wrist", "wrist", 0.006, 0.5),
)  # fmt: skip


def height(name):
    return PLACES.get(name, PLACES.get(f"left_{name}"))[1][1]


def of_table():
    sides = [1 if first in PLACES else 2 for first, *_ in MASSES]
    places = [height(one) + share * (height(other) - height(one)) for one, other, _, share in MASSES]
    masses = np.array([mass for _, _, mass, _ in MASSES]) * sides
    return float(masses @ places / masses.sum())


def written(joints, name, indent=0):
    parent, place = joints[name]
    start = joints[parent][1] if parent else (0, 0)
    pad = "  " * indent
    rotations = "Zrotation Xrotation Yrotation"
    channels = rotations if parent else f"Xposition Yposition Zposition {rotations}"
    offset = f"{place[0] - start[0]:.6f} {place[1] - start[1]:.6f} 0.0" if parent else "0.0 0.0 0.0"
    lines = [
        f"{pad}{'JOINT' if parent else 'ROOT'} {name}",
        f"{pad}{{",
        f"{pad}  OFFSET {offset}",
        f"{pad}  CHANNELS {len(channels.split())} {channels}",
    ]
    below = [one for one, (above, _) in joints.items() if above == name]
    for one in below:
        lines += written(joints, one, indent + 1)
    if not below:
        lines += [f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0.0 0.0 0.0", f"{pad}  }}"]
    return [*lines, f"{pad}}}"]


def center(joints, file):
    lines = ["HIERARCHY", *written(joints, "pelvis"), "MOTION", "Frames: 1", "Frame Time: 0.033333"]
    root = joints["pelvis"][1]
    values = [root[0], root[1], 0.0, *[0.0] * (3 * len(joints))]
    with open(file, "w") as made:
        made.write("\n".join([*lines, " ".join(f"{value:.6f}" for value in values), ""]))
    return float(np.asarray(pybvh.read_bvh_file(file).center_of_mass())[0, 1])


whole, body = center(PLACES | FINGERS, "whole.bvh"), center(PLACES, "body.bvh")
print(
    f"pybvh {version('pybvh')}: {whole:.2f} m high with {len(PLACES | FINGERS)} joints, "
    f"{body:.2f} m with {len(PLACES)}, {of_table():.2f} m by the table"
)
if [round(value, 2) for value in (whole, body, of_table())] != [1.24, 1.05, 1.02]:
    raise SystemExit("the behaviour has changed")
PYTHON
