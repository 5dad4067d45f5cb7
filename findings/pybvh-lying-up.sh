#!/bin/sh
# A BVH skeleton rests upright along y, as most do. In its only frame the person lies on the back, as in a photo of a
# bed. pybvh, whose floor and contacts of feet need up, opens it.
# Guessed: up is y, by the rest pose.
# Measured on 2026-11-30 with pybvh 0.9.0: up is -z, along the body, with a warning that the head is that way of the
# hips. If a frame in which the person stands comes first, up is y.
. "$(dirname "$0")/common.sh"
install pybvh==0.9.0 numpy==2.4.6
python - <<'PYTHON'
import warnings
from importlib.metadata import version

import numpy as np
import pybvh

CHANNELS = "CHANNELS 3 Zrotation Xrotation Yrotation"
LEG = """  JOINT {0}UpLeg { OFFSET {1} 0 0 CHANNELS
    JOINT {0}Leg { OFFSET 0 -42 0 CHANNELS
      JOINT {0}Foot { OFFSET 0 -42 0 CHANNELS
        JOINT {0}ToeBase { OFFSET 0 -5 15 CHANNELS
          End Site { OFFSET 0 0 5 } } } } }"""
PERSON = """HIERARCHY
ROOT Hips { OFFSET 0 0 0 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
LEFT
RIGHT
  JOINT Spine { OFFSET 0 20 0 CHANNELS
    JOINT Head { OFFSET 0 40 0 CHANNELS
      End Site { OFFSET 0 20 0 } } } }"""


def written(poses, file):
    """Write a file of hips' places and rotations, and return what pybvh warns of."""
    legs = {side.upper(): LEG.replace("{0}", side).replace("{1}", x) for side, x in (("Left", "10"), ("Right", "-10"))}
    text = PERSON.replace("LEFT", legs["LEFT"]).replace("RIGHT", legs["RIGHT"])
    text = text.replace("CHANNELS\n", f"{CHANNELS}\n")
    for mark in ("{", "}", "CHANNELS"):  # each on a line of its own
        text = text.replace(f" {mark}", f"\n{mark}")
    text = text.replace("{ ", "{\n")
    frames = [" ".join(map(str, [*pose, *[0] * 30])) for pose in poses]
    with open(file, "w") as made:
        made.write("\n".join([text, "MOTION", f"Frames: {len(frames)}", "Frame Time: 0.033333", *frames, ""]))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        person = pybvh.read_bvh_file(file)
        up = person.world_up
    return up, any("world up" in str(one.message) for one in said), person


LYING, STANDING = (0, 20, 0, 0, -90, 0), (0, 89, 0, 0, 0, 0)
alone, warned, person = written([LYING], "lying.bvh")
first, quiet, _ = written([STANDING, LYING], "standing.bvh")
head = np.asarray(person.joint_positions())[0, person.joint_names.index("Head")]
print(
    f"pybvh {version('pybvh')}: up of a person who lies {alone}, warned {warned}, head at {head.round().tolist()}; "
    f"after a frame of standing {first}, warned {quiet}"
)
if (alone, warned, first, quiet) != ("-z", True, "+y", False):
    raise SystemExit("the behaviour has changed")
PYTHON
