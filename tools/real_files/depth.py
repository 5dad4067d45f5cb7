"""Make depth files of the tests anew with the code of the tools that write them.

python -m venv venv
venv/bin/pip install opencv-python-headless==4.14.0.94 depth-anything-3==0.1.1
venv/bin/python tools/real_files/depth.py plugins/embedded/tests/opencv/exr
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np

DEPTH = np.linspace(1, 5, 28 * 42, dtype=np.float32).reshape(28, 42)


def opencv(folder: Path) -> None:
    """Write EXR by ``cv2.imwrite``: one channel, and three equal ones; OpenCV 5 has no EXR."""
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    cv2.imwrite(str(folder / "opencv4_one.exr"), DEPTH)
    cv2.imwrite(str(folder / "opencv4_three.exr"), np.dstack([DEPTH] * 3))


def depth_anything_3(folder: Path) -> None:
    """Write the archive that the option ``export_format="npz"`` writes for one picture."""
    from depth_anything_3.specs import Prediction
    from depth_anything_3.utils.export.npz import export_to_npz

    picture = np.zeros((1, *DEPTH.shape, 3), np.uint8)
    found = Prediction(
        depth=DEPTH[None], is_metric=1, processed_images=picture, conf=np.ones_like(DEPTH)[None]
    )
    with tempfile.TemporaryDirectory() as place:
        export_to_npz(found, place)
        for thread in threading.enumerate():  # it writes in a thread that no one waits for
            if thread is not threading.current_thread():
                thread.join()
        (folder / "depth_anything_3.npz").write_bytes(
            Path(place, "exports/npz/results.npz").read_bytes()
        )


opencv(Path(sys.argv[1]))
depth_anything_3(Path(sys.argv[1]))
