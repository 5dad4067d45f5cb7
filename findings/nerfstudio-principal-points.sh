#!/bin/sh
# A photo of 1440 x 1920 px has its principal point 20 px to the right of the middle, and 30 px above it. OpenDroneMap
# states it in shares of the longer side, Record3D, which records the depth of phones, in its matrix K. nerfstudio
# makes a transforms.json of either.
# Guessed: 740 and 930 px, or half a pixel beside.
# Measured on 2026-11-29 with nerfstudio 1.1.5: the middle of the picture in both, in silence, so 36 px beside. It
# adds the shares of OpenDroneMap to the middle as if they were px, and leaves the point of Record3D out, as a comment
# of its source says. Focal lengths are right.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install numpy==2.4.6 scipy==1.17.1 opencv-python-headless==5.0.0.93 rich==14.3.3 imageio==2.38.1 rawpy==0.27.0 \
    requests==2.34.2
install --no-deps nerfstudio==1.1.5
python -W ignore - <<'PYTHON'
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
from nerfstudio.process_data.odm_utils import cameras2nerfds
from nerfstudio.process_data.record3d_utils import record3d_to_json

WIDTH, HEIGHT, FOCAL, CENTRE = 1440, 1920, 1500.0, (740.0, 930.0)
photo, here = Path("photo.jpg"), Path(".")


def found():
    """Focal length and principal point of the transforms.json, px."""
    document = json.loads(Path("transforms.json").read_text())
    camera = document | document["frames"][0]
    return [round(camera[name]) for name in ("fl_x", "cx", "cy")]


drone = {
    "projection_type": "brown",
    "width": WIDTH,
    "height": HEIGHT,
    "focal_x": FOCAL / HEIGHT,
    "focal_y": FOCAL / HEIGHT,
    "c_x": (CENTRE[0] - WIDTH / 2) / HEIGHT,
    "c_y": (CENTRE[1] - HEIGHT / 2) / HEIGHT,
} | dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0)
shot = {"filename": "photo.jpg", "rotation": [0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0], "camera": "drone"}
features = [{"type": "Feature", "properties": shot}]
Path("cameras.json").write_text(json.dumps({"drone": drone}))
Path("shots.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
files = Path("cameras.json"), Path("shots.geojson"), Path("reconstruction.json")
cameras2nerfds({"photo": photo}, *files, here)
of_drone = found()
phone = {
    "w": WIDTH,
    "h": HEIGHT,
    "fps": 30,
    "K": [FOCAL, 0, 0, 0, FOCAL, 0, *CENTRE, 1],
    "poses": [[0, 0, 0, 1, 0, 0, 0]],
}
Path("metadata.json").write_text(json.dumps(phone))
record3d_to_json([photo], Path("metadata.json"), here, np.array([0]))
of_phone = found()
print(f"nerfstudio {version('nerfstudio')}: focal length and centre of OpenDroneMap {of_drone}, of Record3D {of_phone}")
if (of_drone, of_phone) != ([1500, 720, 959], [1500, 720, 960]):
    raise SystemExit("the behaviour has changed")
PYTHON
