#!/bin/sh
# Pose2Sim converts EasyMocap's intri.yml and extri.yml to its Calib.toml.
# Guessed: five coefficients of distortion arrive, or an error.
# Measured on 2026-11-27 with pose2sim 0.10.49: the fifth, k3, is left out without a warning. With k3 = 0.2 the corner
# of the picture moves by 53 px. The size that the file states is not read, but is twice the principal point, as a
# comment of its source says.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install numpy==2.4.6 scipy==1.17.1 pandas==3.1.1 matplotlib==3.11.2 opencv-python-headless==5.0.0.93 \
    rtoml==0.14.0 lxml==6.1.3 c3d==0.6.0 anytree==2.13.0 tqdm==4.70.1
install --no-deps pose2sim==0.10.49
python - "$folder" <<'PYTHON' 2>"$folder/log" || { cat "$folder/log" >&2; exit 1; }
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
from Pose2Sim.calibration import calib_easymocap_fun, toml_write

folder = Path(sys.argv[1])
K = np.array([[1400.0, 0, 967.25], [0, 1400, 533.5], [0, 0, 1]])
distortion = np.array([[-0.1, 0.02, 0.0, 0.0, 0.2]])
head = '%YAML:1.0\n---\nnames:\n  - "left"\n'


def matrix(key, values):
    rows, columns = values.shape
    data = ", ".join(f"{value:.6f}" for value in values.ravel())
    return f"{key}: !!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data: [{data}]\n"


size = "H_left: 1080\nW_left: 1920\n"
(folder / "intri.yml").write_text(head + matrix("K_left", K) + matrix("dist_left", distortion) + size)
(folder / "extri.yml").write_text(
    head + matrix("R_left", np.zeros((3, 1))) + matrix("Rot_left", np.eye(3)) + matrix("T_left", np.ones((3, 1)))
)
_, *found = calib_easymocap_fun([str(folder / "extri.yml"), str(folder / "intri.yml")])
toml_write(folder / "Calib.toml", *found)
camera = tomllib.loads((folder / "Calib.toml").read_text())["left"]
corner = np.linalg.inv(K) @ (0, 0, 1)
own, its = (
    cv2.projectPoints(corner[None], np.zeros(3), np.zeros(3), K, np.array(values))[0].ravel()
    for values in (distortion.ravel(), camera["distortions"])
)
print(
    f"pose2sim {version('pose2sim')}: distortions {camera['distortions']} of {distortion.ravel().tolist()}, "
    f"size {camera['size']} of [1920, 1080]; a corner moves by {np.linalg.norm(own - its):.1f} px"
)
if (camera["distortions"], camera["size"]) != ([-0.1, 0.02, 0.0, 0.0], [1934.5, 1067.0]):
    raise SystemExit("the behaviour has changed")
PYTHON
