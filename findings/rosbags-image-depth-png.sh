#!/bin/sh
# A depth map of 2000 and 3000 mm is sent as a compressed image of ROS, a PNG of 16 bits ("16UC1; png compressed"), as
# ROS' own transport writes it.
# Guessed: rosbags-image returns 2000 and 3000 in 16 bits, or refuses it.
# Measured on 2026-11-29 with rosbags-image 0.10.4 and OpenCV 5.0.0: 7 and 11 in 8 bits, in silence. If 16 bits are
# asked for (color_space="mono16"), OpenCV refuses it for its number of channels.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install rosbags-image==0.10.4 rosbags==0.11.9 \
    opencv-python-headless==5.0.0.93 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata

import cv2
import numpy as np
from rosbags.image import message_to_cvimage
from rosbags.typesys import Stores, get_typestore

types = get_typestore(Stores.LATEST).types
stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
depth = np.full((4, 4), 2000, np.uint16)
depth[:, 2:] = 3000
_, png = cv2.imencode(".png", depth)
message = types["sensor_msgs/msg/CompressedImage"](header=header, format="16UC1; png compressed", data=png.ravel())
found = message_to_cvimage(message)
try:
    wide = message_to_cvimage(message, "mono16").tolist()
except cv2.error as error:
    wide = type(error).__name__
version = importlib.metadata.version("rosbags-image")
print(f"rosbags-image {version}: {found.dtype} {found[0, 0]} and {found[0, 3]}; as mono16: {wide}")
if not (found.dtype == np.uint8 and (found[0, 0], found[0, 3]) == (7, 11) and wide == "error"):
    raise SystemExit("the behaviour has changed")
PYTHON
