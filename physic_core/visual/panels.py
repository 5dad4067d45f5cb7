"""Preview panels: photo, overlay, depth and contact views, each (H, W, 3) uint8 RGB."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.geometry.upright import gltf_from_camera, transform_points
from physic_core.visual.orthographic_views import PAGE_RGB
from physic_core.visual.palette import painted_contact
from physic_core.visual.render import (
    LONGEST_BODY_EDGE_M,
    View,
    blend_over,
    prepare_meshes,
    render_mesh,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Reconstruction, UInt8Array
    from physic_core.visual.orthographic_views import PreviewGeometry

    Array = NDArray[np.float64]

_OPACITY = 0.85
"""Opacity of the bodies over the photo."""

CONTACT_VIEWS = ("front", "back", "below")
"""Views of a person that show contact."""

_FAR = 60.0  # metres where the colours end

_LEFT_HIP, _RIGHT_HIP = joint_pair("hip")
_LEFT_SHOULDER, _RIGHT_SHOULDER = joint_pair("shoulder")
_PELVIS, _NECK = JOINT_INDEX["pelvis"], JOINT_INDEX["neck"]


def photo_panel(image: UInt8Array, width: int, height: int) -> UInt8Array:
    """Resize the photo to a panel."""
    import cv2

    way = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=way), np.uint8)


def overlay_panel(reconstruction: Reconstruction, geometry: PreviewGeometry, width: int, height: int) -> UInt8Array:
    """Draw the bodies over the photo; nearer ones hide farther ones."""
    photo = photo_panel(reconstruction.image, width, height)
    return bodies_over(photo, View.perspective(reconstruction.intrinsics, width, height), geometry)


def bodies_over(photo: UInt8Array, view: View, geometry: PreviewGeometry) -> UInt8Array:
    """Draw the bodies over a photo (H, W, 3) as a view of the same size shows them."""
    if geometry.people is None:
        return photo
    layer = render_mesh(geometry.people, view, geometry.people_colors)
    return _bytes(blend_over(layer, (photo / 255.0).astype(np.float32), _OPACITY))


def depth_range(reconstruction: Reconstruction) -> tuple[float, float]:
    """Return minimum and maximum depth of the colour map, metres."""
    scene = reconstruction.scene
    depth = scene.points[..., 2][scene.valid & np.isfinite(scene.points[..., 2])]
    if not depth.size:
        return 1.0, 10.0
    near, far = (float(value) for value in np.percentile(depth[:: max(1, depth.size // 100_000)], [1, 99]))
    near = max(near, 0.05)
    return near, max(min(far, _FAR), near * 1.1)


def depth_panel(reconstruction: Reconstruction, width: int, height: int) -> UInt8Array:
    """Draw the depth of the scene without people, with outlines of people in white and unknown depth in grey."""
    import cv2

    def shrunk(array: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(cv2.resize(array, (width, height), interpolation=cv2.INTER_NEAREST))

    scene = reconstruction.scene
    near, far = depth_range(reconstruction)
    depth = shrunk(np.nan_to_num(scene.points[..., 2], nan=far, posinf=far, neginf=near).astype(np.float32))
    picture = colored_depth(depth, near, far)
    picture[shrunk(scene.valid.astype(np.uint8)) == 0] = (190, 190, 188)
    for person in reconstruction.people:
        outline, _ = cv2.findContours(shrunk(person.mask.astype(np.uint8)), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, outline, -1, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def colored_depth(depth: NDArray[Any], near: float, far: float) -> UInt8Array:
    """Convert a depth map (H, W) in metres to turbo colours of its logarithm, near red, far blue."""
    import cv2

    share = np.clip(np.log(far / np.clip(depth, near, far)) / np.log(far / near), 0.0, 1.0)
    colors = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.ascontiguousarray(colors[..., ::-1], dtype=np.uint8)


def render_contact_views(reconstruction: Reconstruction, index: int, width: int, height: int) -> UInt8Array:
    """Draw one person as in ``CONTACT_VIEWS``, side by side, with contact in the colour of what is touched.

    The view from below is enlarged by up to 1.5 times.
    """
    person = reconstruction.people[index]
    matrix = gltf_from_camera(reconstruction.scene.floor)
    vertices, joints = transform_points(matrix, person.vertices), transform_points(matrix, person.joints)
    picture = np.tile((np.array(PAGE_RGB) / 255).astype(np.float32), (height, width, 1))
    shapes = prepare_meshes([vertices], reconstruction.faces, longest_edge=LONGEST_BODY_EDGE_M)
    if shapes is None or not np.isfinite(vertices).all():
        return _bytes(picture)
    colors = painted_contact(person, reconstruction.contact_partners) / 255.0
    edges = np.linspace(0, width, len(CONTACT_VIEWS) + 1).astype(int)
    corners, fits = [], []
    for (right, top), room in zip(_view_axes(joints), np.diff(edges), strict=True):
        axes = np.stack([right, top, np.cross(right, top)])
        low, high = (vertices @ axes.T).min(0), (vertices @ axes.T).max(0)
        corners.append((axes, axes.T @ ((low + high) / 2)))
        fits.append(min(room / (high[0] - low[0] + 0.1), height / (high[1] - low[1] + 0.1)))
    upright = min(fits[:2])
    scales = upright, upright, min(fits[2], 1.5 * upright)
    for (axes, middle), scale, left, end in zip(corners, scales, edges[:-1], edges[1:], strict=True):
        view = View.orthographic(axes, middle, scale, (int(end - left), height))
        picture[:, left:end] = blend_over(render_mesh(shapes, view, colors), picture[:, left:end])
    return _bytes(picture)


def _view_axes(joints: Array) -> list[tuple[Array, Array]]:
    """Return right and top axes (upright frame) of each of ``CONTACT_VIEWS`` of one person."""
    up = np.array([0.0, 1.0, 0.0])
    left = joints[_LEFT_HIP] - joints[_RIGHT_HIP] + joints[_LEFT_SHOULDER] - joints[_RIGHT_SHOULDER]
    spine = _unit(joints[_NECK] - joints[_PELVIS], up)
    front = _unit(np.cross(left, spine), np.array([0.0, 0.0, 1.0]))
    top = up - (up @ front) * front
    # The front of a person lying on the back points up: draw their head at the top of the image.
    top = _unit(top if np.linalg.norm(top) > 0.5 else spine - (spine @ front) * front, up)
    level = front - (front @ up) * up
    level = _unit(level if np.linalg.norm(level) > 0.5 else top - (top @ up) * up, np.array([0.0, 0.0, 1.0]))
    return [(np.cross(top, front), top), (np.cross(front, top), top), (np.cross(level, -up), level)]


def _unit(vector: Array, otherwise: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-6 else otherwise


def _bytes(picture: NDArray[Any]) -> UInt8Array:
    return np.asarray(np.clip(picture, 0.0, 1.0) * 255 + 0.5, np.uint8)
