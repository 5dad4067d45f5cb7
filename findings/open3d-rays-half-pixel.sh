#!/bin/sh
# Open3D renders the depth of a tilted plane with the rays of a pinhole camera, and turns that depth into points with
# the same matrix K.
# Guessed: the points lie on the plane.
# Measured on 2026-11-29 with open3d 0.20.0: they lie 10 mm beside it at 2 m, for 50 px of focal length:
# `create_rays_pinhole` counts pixels from their edges, and `create_from_depth_image` from their middles, in both of
# its classes, so points are half a pixel off. Needs the system libraries of its wheel (Debian: libusb-1.0-0, libgl1,
# libegl1, libx11-6).
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install open3d==0.20.0 numpy==2.4.6
python - <<'PYTHON'
import numpy as np
import open3d as o3d

WIDTH, HEIGHT, FOCAL = 64, 48, 50.0
K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
plane = o3d.geometry.TriangleMesh.create_box(20, 20, 0.1).translate([-10, -10, 2])
plane.rotate(o3d.geometry.get_rotation_matrix_from_xyz([0.5, 0, 0]), center=[0, 0, 2])
scene = o3d.t.geometry.RaycastingScene()
scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(plane))
rays = scene.create_rays_pinhole(o3d.core.Tensor(K), o3d.core.Tensor(np.eye(4)), WIDTH, HEIGHT)
reach = scene.cast_rays(rays)["t_hit"].numpy()
rays = rays.numpy()
depth = (reach * rays[..., 5]).astype(np.float32)


def off_the_plane(points):
    distances = scene.compute_distance(o3d.core.Tensor(np.asarray(points, np.float32)))
    return 1000 * float(distances.numpy().mean())


intrinsic = o3d.camera.PinholeCameraIntrinsic(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
legacy = o3d.geometry.PointCloud.create_from_depth_image(
    o3d.geometry.Image(depth), intrinsic, depth_scale=1.0, depth_trunc=100.0
)
tensor = o3d.t.geometry.PointCloud.create_from_depth_image(
    o3d.t.geometry.Image(depth[..., None]), o3d.core.Tensor(K), depth_scale=1.0, depth_max=100.0
)
along_rays = off_the_plane((rays[..., :3] + reach[..., None] * rays[..., 3:]).reshape(-1, 3))
found = [off_the_plane(np.asarray(legacy.points)), off_the_plane(tensor.point.positions.numpy())]
print(f"open3d {o3d.__version__}: mm off the plane: {along_rays:.2f} along rays, {np.round(found, 1)} by depth")
if not (along_rays < 0.1 and all(abs(distance - 9.8) < 0.1 for distance in found)):
    raise SystemExit("the behaviour has changed")
PYTHON
