#!/bin/sh
# pypcd4 writes points with colours to PCD in each of its encodings, and reads them again.
# Guessed: the same colours.
# Measured on 2026-11-29 with pypcd4 1.5.1: they are, in the binary encodings. In ASCII all are black, in silence: it
# stores a colour as the bits of a float, as PCL does, which is below 1e-37, and writes ten decimals.
. "$(dirname "$0")/common.sh"
install pypcd4==1.5.1 python-neo-lzf==0.3.5 \
    pydantic==2.14.4 numpy==2.4.6
python -W error - <<'PYTHON'
import numpy as np
import pypcd4
from pypcd4 import Encoding, PointCloud

colours = [[255, 128, 64], [10, 20, 30]]
rgb = PointCloud.encode_rgb(np.array(colours, np.uint8))
cloud = PointCloud.from_xyzrgb_points(np.column_stack([np.ones((2, 3)), rgb]).astype(np.float32))
found = {}
for encoding in (Encoding.BINARY, Encoding.BINARY_COMPRESSED, Encoding.ASCII):
    cloud.save("cloud.pcd", encoding=encoding)
    found[encoding.name] = PointCloud.decode_rgb(PointCloud.from_path("cloud.pcd").pc_data["rgb"]).tolist()
    print(f"pypcd4 {pypcd4.__version__}, {encoding.name}: {found[encoding.name]}")
if found != {"BINARY": colours, "BINARY_COMPRESSED": colours, "ASCII": [[0, 0, 0], [0, 0, 0]]}:
    raise SystemExit("the behaviour has changed")
PYTHON
