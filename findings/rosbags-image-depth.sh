#!/bin/sh
# A depth camera of ROS publishes 16-bit depth in millimeters: as a PNG (CompressedImage, "16UC1; png compressed"), and
# as an Image whose rows are padded (`step` is larger than two bytes times the width). rosbags-image reads both.
# Guessed: the millimeters, of both.
# Measured on 2026-12-01 with rosbags-image 0.10.4 and OpenCV 4.14.0: the PNG becomes 8 bits in silence: 1000 and
# 2000 mm are 3 and 7. The padding becomes pixels: each row after the first begins with the padding of the one before.
# Readers guessed: wrong, right for the PNG alone, right for the rows alone.
. "$(dirname "$0")/common.sh"
install rosbags==0.11.9 rosbags-image==0.10.4 opencv-python-headless==4.14.0.94 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import cv2
import numpy as np
from rosbags.image import message_to_cvimage
from rosbags.typesys import Stores, get_typestore

types = get_typestore(Stores.ROS2_HUMBLE).types
header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="")
depth_mm = np.array([[1000, 2000], [3000, 65000]], np.uint16)

png = np.frombuffer(cv2.imencode(".png", depth_mm)[1].tobytes(), np.uint8)
compressed = types["sensor_msgs/msg/CompressedImage"](header=header, format="16UC1; png compressed ", data=png)
from_png = message_to_cvimage(compressed)

padded = np.hstack([depth_mm, np.full((2, 1), 9, np.uint16)])
image = types["sensor_msgs/msg/Image"](
    header=header,
    height=2,
    width=2,
    encoding="16UC1",
    is_bigendian=0,
    step=6,
    data=np.frombuffer(padded.tobytes(), np.uint8),
)
from_rows = message_to_cvimage(image)
print(f"rosbags-image {version('rosbags-image')}: PNG {from_png.dtype} {from_png.tolist()}; rows {from_rows.tolist()}")
if from_png.tolist() != [[3, 7], [11, 253]] or from_rows.tolist() != [[1000, 2000], [9, 3000]]:
    raise SystemExit("the behaviour has changed")
PYTHON
