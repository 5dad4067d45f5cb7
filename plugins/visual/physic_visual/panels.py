"""Preview panels: photo, overlay, depth and contact views, each (H, W, 3) uint8 RGB."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from PIL import ImageDraw, ImageFont

from physic_core.body import JOINT_INDEX, joint_pair
from physic_core.geometry import transform_points, vertex_normals, world_from_camera
from physic_visual.palette import painted_contact, person_color
from physic_visual.render import (
    View,
    blend_over,
    picture_bytes,
    prepare_meshes,
    render_mesh,
    shade,
)
from physic_visual.views import PAGE_RGB

if TYPE_CHECKING:
    from physic_core.types import AnyArray, Float64Array, Int64Array, Reconstruction, UInt8Array
    from physic_visual.views import PreviewGeometry


_OUTLINE_PX = 2
_STEP = 0.05  # difference of colour between two people, or a person and the background, of 1

CONTACT_VIEWS = ("front", "back", "soles")
"""Views of a person that show contact."""

_FAR = 60.0  # metres where the colours end

_LEFT_HIP, _RIGHT_HIP = joint_pair("hip")
_LEFT_SHOULDER, _RIGHT_SHOULDER = joint_pair("shoulder")
_PELVIS = JOINT_INDEX["pelvis"]
_NECK = JOINT_INDEX["neck"]
# The font has none of these.
_PLAIN = str.maketrans(
    {"×": "x", "—": "-", "–": "-", "−": "-", "’": "'", "‘": "'", "“": '"', "”": '"', "…": "..."}
)

UNKNOWN_RGB = (190, 190, 188)
"""sRGB colour of unknown depth."""

INK_RGB = (32, 34, 38)
SOFT_RGB = (98, 102, 108)


def photo_panel(image: UInt8Array, width: int, height: int) -> UInt8Array:
    """Resize the photo to a panel."""
    import cv2

    way = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=way), np.uint8)


def overlay_panel(
    reconstruction: Reconstruction, geometry: PreviewGeometry, width: int, height: int
) -> UInt8Array:
    """Draw the bodies over the photo; nearer ones hide farther ones."""
    photo = photo_panel(reconstruction.image, width, height)
    return bodies_over(photo, View.perspective(reconstruction.intrinsics, width, height), geometry)


def bodies_over(photo: UInt8Array, view: View, geometry: PreviewGeometry) -> UInt8Array:
    """Draw the dressed bodies, each in an outline, over a photo (H, W, 3) as a view of the same
    size shows them.
    """
    import cv2

    if geometry.people is None:
        return photo
    colors = np.concatenate([geometry.dress_colors, geometry.people_colors], 1)
    layer = render_mesh(geometry.people, view, colors)
    dressed, plain = (np.ascontiguousarray(one) for one in np.split(layer.color, 2, axis=-1))
    plain = cv2.medianBlur(plain, 3)  # a ray may pass between two triangles
    picture = blend_over(replace(layer, color=dressed), (photo / 255.0).astype(np.float32))
    near = np.ones((2 * _OUTLINE_PX + 1,) * 2, np.uint8)
    step = cv2.dilate(plain, near) - cv2.erode(plain, near, borderType=cv2.BORDER_REPLICATE)
    outline = (layer.alpha == 1) & (step > _STEP).any(-1)
    picture[outline] = plain[outline]
    return picture_bytes(picture)


def depth_range(reconstruction: Reconstruction) -> tuple[float, float]:
    """Return minimum and maximum depth of the colour map, metres."""
    scene = reconstruction.scene
    depth = scene.points[..., 2][scene.valid & np.isfinite(scene.points[..., 2])]
    if not depth.size:
        return 1.0, 10.0
    near, far = (
        float(value) for value in np.percentile(depth[:: max(1, depth.size // 100_000)], [1, 99])
    )
    near = max(near, 0.05)
    return near, max(min(far, _FAR), near * 1.1)


def depth_panel(reconstruction: Reconstruction, width: int, height: int) -> UInt8Array:
    """Draw the depth of the scene without people, with outlines of people in white and unknown
    depth in grey.
    """
    import cv2

    def shrunk(array: AnyArray) -> AnyArray:
        return np.asarray(cv2.resize(array, (width, height), interpolation=cv2.INTER_NEAREST))

    scene = reconstruction.scene
    near, far = depth_range(reconstruction)
    depth = shrunk(
        np.nan_to_num(scene.points[..., 2], nan=far, posinf=far, neginf=near).astype(np.float32)
    )
    picture = colored_depth(depth, near, far)
    picture[shrunk(scene.valid.astype(np.uint8)) == 0] = UNKNOWN_RGB
    for person in reconstruction.people:
        outline, _ = cv2.findContours(
            shrunk(person.mask.astype(np.uint8)), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(picture, outline, -1, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def colored_depth(depth: AnyArray, near: float, far: float) -> UInt8Array:
    """Convert a depth map (H, W) in metres to turbo colours of its logarithm, near red, far
    blue.
    """
    import cv2

    share = np.clip(np.log(far / np.clip(depth, near, far)) / np.log(far / near), 0.0, 1.0)
    colors = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.ascontiguousarray(colors[..., ::-1], dtype=np.uint8)


def render_contact_views(
    reconstruction: Reconstruction, index: int, width: int, height: int
) -> UInt8Array:
    """Draw one person as in ``CONTACT_VIEWS``, side by side, with contact in the colour of what is
    touched.

    The view from below is enlarged by up to 1.5 times.
    """
    person = reconstruction.people[index]
    matrix = world_from_camera(reconstruction.scene.level)
    vertices = transform_points(matrix, person.vertices)
    joints = transform_points(matrix, person.joints)
    picture = np.tile((np.array(PAGE_RGB) / 255).astype(np.float32), (height, width, 1))
    if not person.has_body:
        return picture_bytes(picture)
    caster = prepare_meshes([vertices], np.asarray(reconstruction.faces, np.int64))
    if caster is None:
        return picture_bytes(picture)
    edges = np.linspace(0, width, len(CONTACT_VIEWS) + 1).astype(int)
    views = _contact_cameras(vertices, joints, np.diff(edges), height)
    paint = painted_contact(person, reconstruction.contact_partners) / 255.0
    normals = vertex_normals(vertices, caster.faces)
    for view, left, end in zip(views, edges[:-1], edges[1:], strict=True):
        layer = render_mesh(caster, view, shade(normals, view.axes, paint))
        picture[:, left:end] = blend_over(layer, picture[:, left:end])
    return picture_bytes(picture)


def _contact_cameras(
    vertices: Float64Array, joints: Float64Array, widths: Int64Array, height: int
) -> list[View]:
    """Return the cameras of ``CONTACT_VIEWS`` of a person, for pictures of a size in px."""
    sides = _view_axes(joints)
    reach = np.stack([vertices @ axes.T for axes in sides])
    low = reach.min(1)
    high = reach.max(1)
    extent = high - low + 0.1
    fits = np.minimum(widths / extent[:, 0], height / extent[:, 1])
    upright = fits[:2].min()
    scales = upright, upright, min(fits[2], 1.5 * upright)
    return [
        View.orthographic(axes, axes.T @ middle, scale, (int(width), height))
        for axes, middle, scale, width in zip(sides, (low + high) / 2, scales, widths, strict=True)
    ]


def _view_axes(joints: Float64Array) -> list[Float64Array]:
    """Return the axes (3, 3) to the right, the top and the eye (upright frame) of each of
    ``CONTACT_VIEWS`` of one person.
    """
    up = np.array([0.0, 1.0, 0.0])
    left = joints[_LEFT_HIP] - joints[_RIGHT_HIP] + joints[_LEFT_SHOULDER] - joints[_RIGHT_SHOULDER]
    spine = _unit(joints[_NECK] - joints[_PELVIS], up)
    front = _unit(np.cross(left, spine), np.array([0.0, 0.0, 1.0]))
    top = up - (up @ front) * front
    # The front of a person lying on the back points up: draw their head at the top of the image.
    top = _unit(top if np.linalg.norm(top) > 0.5 else spine - (spine @ front) * front, up)
    level = front - (front @ up) * up
    level = _unit(
        level if np.linalg.norm(level) > 0.5 else top - (top @ up) * up, np.array([0.0, 0.0, 1.0])
    )
    sides = (np.cross(top, front), top), (np.cross(front, top), top), (np.cross(level, -up), level)
    return [np.stack([right, above, np.cross(right, above)]) for right, above in sides]


def _unit(vector: Float64Array, otherwise: Float64Array) -> Float64Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-6 else otherwise


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font of the preview, size in px."""
    return ImageFont.load_default(size)


def draw_text(
    pen: ImageDraw.ImageDraw,
    spot: tuple[float, float],
    text: str,
    size: int,
    color: tuple[int, int, int] = INK_RGB,
    anchor: str = "la",
    *,
    rim: tuple[int, int, int] | None = None,
) -> None:
    """Draw one line of text with its upper left corner, or another of Pillow's anchors, at a spot,
    px; with a rim of a colour, it can be read on any picture.
    """
    pen.text(
        spot,
        text.translate(_PLAIN),
        font=font(size),
        fill=color,
        anchor=anchor,
        stroke_width=0 if rim is None else 2,
        stroke_fill=rim,
    )


def draw_person_number(pen: ImageDraw.ImageDraw, x: float, y: float, index: int) -> None:
    """Draw a person's number on a disc in their colour."""
    pen.ellipse(
        (x - 11, y - 11, x + 11, y + 11), fill=person_color(index), outline=(255, 255, 255), width=2
    )
    draw_text(pen, (x, y), str(index), 14, (20, 20, 20), "mm")
