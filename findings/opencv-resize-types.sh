#!/bin/sh
# OpenCV resizes labels of 64 bits, and maps of 133 channels (keypoints of COCO whole-body).
# Guessed: the same labels, and 133 channels, or an error for both.
# Measured on 2026-11-27 with opencv-python-headless 5.0.0.93: labels become int32 and wrap without a warning; more
# than 128 channels are an error (4.14 takes 512).
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install opencv-python-headless==5.0.0.93
python - <<'PYTHON'
import cv2
import numpy as np

label = 2**31 + 5
found = cv2.resize(np.full((6, 8), label), (4, 3), interpolation=cv2.INTER_NEAREST_EXACT)


def takes(channels):
    try:
        return cv2.resize(np.zeros((6, 8, channels), np.float32), (16, 12)).shape == (12, 16, channels)
    except cv2.error:
        return False


print(f"cv2 {cv2.__version__}: label {label} int64 -> {found[0, 0]} {found.dtype}")
print(f"128 channels: {takes(128)}, 129 channels: {takes(129)}")
if (found.dtype, int(found[0, 0]), takes(128), takes(129)) != (np.int32, label - 2**32, True, False):
    raise SystemExit("the behaviour has changed")
PYTHON
