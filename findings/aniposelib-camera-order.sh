#!/bin/sh
# aniposelib writes the cameras c0 to c10 and loads its own file.
# Guessed: the same cameras in the same order.
# Measured on 2026-11-27 with aniposelib 0.8.0: c0, c1, c10, c2, ...: tables are sorted as text. Pixels of each
# camera, which `CameraGroup.triangulate` takes in the order of the cameras, are those of another camera from the
# third on.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install numpy==2.4.6 scipy==1.17.1 numba==0.68.1 pandas==3.1.1 toml==0.10.2 tqdm==4.70.1 opencv-python-headless==5.0.0.93
install --no-deps aniposelib==0.8.0
python - "$folder/calibration.toml" <<'PYTHON'
import sys
from importlib.metadata import version

from aniposelib.cameras import Camera, CameraGroup

names = [f"c{i}" for i in range(11)]
CameraGroup([Camera(size=(64, 48), name=name) for name in names]).dump(sys.argv[1])
loaded = CameraGroup.load(sys.argv[1]).get_names()
print(f"aniposelib {version('aniposelib')}: written {' '.join(names)}, loaded {' '.join(loaded)}")
if loaded != sorted(names):
    raise SystemExit("the behaviour has changed")
PYTHON
