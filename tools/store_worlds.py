"""Write the worlds of the ordinary photos of the conformance kit; again if the code of worlds
changes.
"""

from __future__ import annotations

import os

os.environ["PHYSIC_WORLD_CACHE"] = "off"

import cv2
import numpy as np
import torch

from physic_core.body import load_body
from physic_core.files.plain import write_value
from physic_testing.conformance.cases import EVIDENCE, build_case
from physic_testing.worlds.scene_setup import set_up_scene
from physic_testing.worlds.stored_worlds import StoredWorld, file_of

model = load_body("embedded").to(dtype=torch.float64)
for old in file_of("*", 0, (0, 0)).parent.glob("*-*-*-*.npz"):
    old.unlink()
for case in ("odd size", *EVIDENCE):
    world = build_case(case).truth
    size = world.intrinsics.width, world.intrinsics.height
    _, stage = set_up_scene(model, world.name, world.seed, size)
    pictures = np.concatenate([world.image, world.empty_image - world.image])
    _, png = cv2.imencode(".png", pictures, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    write_value(
        file_of(world.name, world.seed, size), StoredWorld(stage, np.asarray(png, np.uint8))
    )
