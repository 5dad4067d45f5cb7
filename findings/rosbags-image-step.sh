#!/bin/sh
# An image message of ROS, 3 x 2 px of one byte, has rows of 4 bytes (step 4), as drivers pad them; its pixels are 1
# to 3 and 4 to 6.
# Guessed: rosbags-image returns these, or refuses the padding.
# Measured on 2026-11-29 with rosbags-image 0.10.4: it returns 1, 2, 3 and 0, 4, 5, in silence: it does not read
# `step`, so each row is shifted by one pixel more.
. "$(dirname "$0")/common.sh"
install rosbags-image==0.10.4 rosbags==0.11.9 \
    opencv-python-headless==5.0.0.93 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata

import numpy as np
from rosbags.image import message_to_cvimage
from rosbags.typesys import Stores, get_typestore

types = get_typestore(Stores.LATEST).types
stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
rows = np.array([[1, 2, 3, 0], [4, 5, 6, 0]], np.uint8)
message = types["sensor_msgs/msg/Image"](
    header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera"),
    height=2,
    width=3,
    encoding="mono8",
    is_bigendian=0,
    step=4,
    data=rows.ravel(),
)
found = message_to_cvimage(message).tolist()
print(f"rosbags-image {importlib.metadata.version('rosbags-image')}: {found}")
if found != [[1, 2, 3], [0, 4, 5]]:
    raise SystemExit("the behaviour has changed")
PYTHON
