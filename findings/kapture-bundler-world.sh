#!/bin/sh
# Two cameras and a point of one world, as a Bundler file (.out) and as an NVM file, which programs of structure from
# motion write. kapture reads both, and writes them for COLMAP.
# Guessed: the cameras and the point have the same places in both.
# Measured on 2026-11-29 with kapture 1.1.12 and pycolmap 4.2.1: those of the NVM file have. All of the Bundler file is
# turned by 180 degrees about x, in silence, the point and the centres of the cameras: 2 m up is 2 m down. Pictures fit
# their points within .01 px, so nothing shows it, but a mesh or a floor of the same scene lies elsewhere.
# Readers guessed: in part, in part, wrong.
. "$(dirname "$0")/common.sh"
install kapture==1.1.12 pycolmap==4.2.1 numpy==2.4.6 pillow==13.0.0
PATH="$folder/venv/bin:$PATH" python -W ignore - <<'PYTHON'
import subprocess
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pycolmap
from PIL import Image

WIDTH, HEIGHT, FOCAL = 640, 480, 500.0
POINT = np.array([0.2, 2.0, 4.0])
CENTRES = {"one.jpg": np.array([0.0, 0.5, 0.0]), "two.jpg": np.array([0.5, 0.4, 0.1])}
FLIP = np.diag([1.0, -1.0, -1.0])  # A camera of Bundler has y up and looks along -z; one of NVM has y down.
VIEWS = "2 0 0 0 0 1 0 0 0"


def text(values):
    return " ".join(map(str, np.ravel(values)))


def picture(name):
    return FOCAL * (POINT - CENTRES[name])[:2] / (POINT - CENTRES[name])[2] + (WIDTH / 2, HEIGHT / 2)


Path("photos").mkdir()
bundler, nvm = ["# Bundle file v0.3", "2 1"], ["NVM_V3", "", "2"]
for name, centre in CENTRES.items():
    Image.new("RGB", (WIDTH, HEIGHT)).save(f"photos/{name}")
    bundler += [f"{FOCAL} 0 0", *map(text, FLIP), text(FLIP @ -centre)]
    nvm += [f"{name}\t{FOCAL} 1 0 0 0 {text(centre)} 0 0"]
Path("scene.out").write_text("\n".join([*bundler, text(POINT), "200 100 50", VIEWS, ""]))
Path("list.txt").write_text("\n".join([*CENTRES, ""]))
Path("scene.nvm").write_text("\n".join([*nvm, "", "1", f"{text(POINT)} 200 100 50 {VIEWS}", "", "0", ""]))


def read(kind, *arguments):
    """Point and centres that COLMAP has, and the largest distance of its picture from the true one, px."""
    subprocess.run(
        [f"kapture_import_{kind}", "-f", *arguments, "--add-reconstruction", "-o", kind],
        check=True,
        capture_output=True,
    )
    command = ["kapture_export_colmap", "-f", "-k", kind, "-db", f"{kind}-colmap/database.db"]
    subprocess.run([*command, "--reconstruction", f"{kind}-colmap/all"], check=True, capture_output=True)
    scene = pycolmap.Reconstruction(f"{kind}-colmap/all")
    point = next(iter(scene.points3D.values())).xyz
    centres = {image.name: image.projection_center() for image in scene.images.values()}
    off = max(np.abs(image.project_point(point) - picture(image.name)).max() for image in scene.images.values())
    return [point, *(centres[name] for name in CENTRES)], off


of_bundler, off = read("bundler", "-i", "scene.out", "-l", "list.txt", "-im", "photos")
of_nvm, other = read("nvm", "-i", "scene.nvm", "-im", "photos")
true = [POINT, *CENTRES.values()]
print(f"kapture {version('kapture')}: point of NVM {of_nvm[0].round(3)}, of Bundler {of_bundler[0].round(3)} of {POINT}")
turned = np.allclose(of_bundler, true @ FLIP, atol=1e-6)
if not (np.allclose(of_nvm, true, atol=1e-6) and turned and max(off, other) < 0.01):
    raise SystemExit("the behaviour has changed")
PYTHON
