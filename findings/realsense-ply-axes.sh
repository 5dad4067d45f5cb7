#!/bin/sh
# RealSense's library makes points of a depth map, 2 m away everywhere, and writes them as PLY. No camera is needed:
# its software device takes the map.
# Guessed: the file has the points of `get_vertices`, x right, y down, z ahead.
# Measured on 2026-11-29 with pyrealsense2 2.59.1.11053: the file has y up and z back, so the wall is at z = -2 m, by
# `export_to_ply` and by `save_to_ply`. Poses and boxes in the frame of the camera do not fit it. Pixels without depth
# are left out, so the number of a point is not that of its pixel.
. "$(dirname "$0")/common.sh"
install pyrealsense2==2.59.1.11053 trimesh==5.2.0 \
    numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import pyrealsense2
import trimesh

WIDTH, HEIGHT = 8, 6
sensor = pyrealsense2.software_device().add_sensor("depth")
camera = pyrealsense2.intrinsics()
camera.width, camera.height, camera.fx, camera.fy, camera.ppx, camera.ppy = WIDTH, HEIGHT, 10, 10, 4, 3
stream = pyrealsense2.video_stream()
stream.type, stream.fmt = pyrealsense2.stream.depth, pyrealsense2.format.z16
stream.uid, stream.width, stream.height, stream.fps, stream.bpp = 0, WIDTH, HEIGHT, 30, 2
stream.intrinsics = camera
profile = sensor.add_video_stream(stream)
sensor.add_read_only_option(pyrealsense2.option.depth_units, 0.001)
queue = pyrealsense2.frame_queue(5)
sensor.open(profile)
sensor.start(queue)
depth = np.full((HEIGHT, WIDTH), 2000, np.uint16)
depth[0, 0] = 0
frame = pyrealsense2.software_video_frame()
frame.pixels, frame.stride, frame.bpp, frame.depth_units = depth, 2 * WIDTH, 2, 0.001
frame.timestamp, frame.domain, frame.frame_number = 1.0, pyrealsense2.timestamp_domain.hardware_clock, 1
frame.profile = profile.as_video_stream_profile()
sensor.on_video_frame(frame)
image = queue.wait_for_frame(5000).as_depth_frame()
points = pyrealsense2.pointcloud().calculate(image)
vertices = np.asarray(points.get_vertices()).view(np.float32).reshape(-1, 3)
points.export_to_ply("points.ply", image.as_video_frame())
pyrealsense2.save_to_ply("saved.ply").process(image)
version = importlib.metadata.version("pyrealsense2")
print(f"pyrealsense2 {version}: {len(vertices)} points, the last at {vertices[-1].round(3).tolist()}")
turned = vertices[1:] * [1, -1, -1]
same = True
for name in ("points.ply", "saved.ply"):
    written = trimesh.load(name, process=False).vertices
    print(f"{name}: {len(written)} points, the last at {np.round(written[-1], 3).tolist()}")
    same = same and written.shape == turned.shape and np.allclose(written, turned, atol=1e-6)
if not (same and np.allclose(vertices[-1], [0.6, 0.4, 2])):
    raise SystemExit("the behaviour has changed")
PYTHON
