"""Draw one result on a viser server, under one node that can be moved and removed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
import viser.transforms

from physic_core.visual.palette import CAMERA_RGB, FLOOR_RGB, person_tint
from physic_viewer.shapes import ResultShapes, nearest_on_ray
from physic_viewer.unlit import unlit_glb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Reconstruction

PARTS = {
    "surface": True,
    "points": False,
    "people": True,
    "floor": True,
    "camera": True,
    "names": True,
}
"""Parts of a result that can be switched, and whether they are shown at first."""

SKINS = ("photo", "neutral", "contact")
"""Colours of the people, the first ones at first."""

_FRUSTUM_PX = 320


class DrawnResult:
    """The nodes of one result.

    Args:
        server: to draw on.
        node: name of its node, such as "/0".
        result: what to draw.
        shapes: its meshes and points.
        label: drawn over it.
    """

    def __init__(
        self, server: viser.ViserServer, node: str, result: Reconstruction, shapes: ResultShapes, label: str
    ) -> None:
        self._scene, self.shapes, self.result = server.scene, shapes, result
        self._root = self._scene.add_frame(node, show_axes=False)
        self._parts: dict[str, Any] = {name: self._scene.add_frame(f"{node}/{name}", show_axes=False) for name in PARTS}
        self._skins = {name: self._scene.add_frame(f"{node}/people/{name}", show_axes=False) for name in SKINS}
        self.wear(SKINS[0])
        self._draw_scene(node)
        self._draw_people(node)
        self._draw_camera(node)
        center = (shapes.low + shapes.high) / 2
        self._scene.add_label(f"{node}/names/title", label, position=(center[0], shapes.high[1] + 0.35, center[2]))

    def _draw_scene(self, node: str) -> None:
        vertices, faces, colors = self.shapes.surface
        if len(faces):
            mesh = unlit_glb(vertices, faces, colors)
            self._scene.add_glb(f"{node}/surface/mesh", mesh, cast_shadow=False, receive_shadow=False)
        points, colors = self.shapes.points
        if len(points):
            self._scene.add_point_cloud(
                f"{node}/points/cloud", points.astype(np.float32), colors, point_size=0.012, precision="float32"
            )
        if self.result.scene.floor is not None:
            low, high = np.floor(self.shapes.low), np.ceil(self.shapes.high)
            self._scene.add_grid(
                f"{node}/floor/grid",
                width=float(high[0] - low[0]),
                height=float(high[2] - low[2]),
                plane="xz",
                cell_size=1.0,
                section_size=1.0,
                section_color=FLOOR_RGB,
                position=(float(low[0] + high[0]) / 2, 0.0, float(low[2] + high[2]) / 2),
                shadow_opacity=0.0,
            )

    def _draw_people(self, node: str) -> None:
        for body in self.shapes.bodies:
            name = f"person_{body.index}"
            dressed = unlit_glb(body.vertices, self.shapes.faces, body.colors)
            self._scene.add_glb(f"{node}/people/photo/{name}", dressed, cast_shadow=False, receive_shadow=False)
            self._scene.add_mesh_simple(
                f"{node}/people/neutral/{name}",
                body.vertices.astype(np.float32),
                np.asarray(self.shapes.faces, np.uint32),
                color=person_tint(body.index),
                receive_shadow=False,
            )
            if len(body.contact_faces):
                mesh = unlit_glb(body.contact_vertices, body.contact_faces, body.contact_colors)
                self._scene.add_glb(f"{node}/people/contact/{name}", mesh, cast_shadow=False, receive_shadow=False)
            top = body.vertices[body.vertices[:, 1].argmax()]
            self._scene.add_label(
                f"{node}/names/{name}", f"person {body.index}", position=(top[0], top[1] + 0.08, top[2])
            )

    def _draw_camera(self, node: str) -> None:
        nearest = min((-float(body.vertices[:, 2].max()) for body in self.shapes.bodies), default=2.0)
        for number, view in enumerate(self.result.cameras or [self.result.reference_view()]):
            camera, pose = view.intrinsics, self.shapes.upright @ view.pose
            step = max(1, max(view.image.shape) // _FRUSTUM_PX)
            self._scene.add_camera_frustum(
                f"{node}/camera/frustum_{number}" if number else f"{node}/camera/frustum",
                fov=2 * math.atan(camera.height / 2 / camera.fy),
                aspect=camera.width / camera.height,
                scale=min(0.15, max(0.05, 0.1 * nearest)),
                thickness=0.005,
                color=CAMERA_RGB,
                image=view.image[::step, ::step],
                wxyz=viser.transforms.SO3.from_matrix(pose[:3, :3]).wxyz,
                position=tuple(pose[:3, 3]),
                cast_shadow=False,
            )

    def move(self, offset: NDArray[np.float64]) -> None:
        """Place the result at an offset (3,), metres."""
        self._root.position = np.asarray(offset, np.float64)

    @property
    def offset(self) -> NDArray[np.float64]:
        """Offset (3,) of the result, metres."""
        return np.asarray(self._root.position, np.float64)

    def show(self, part: str, shown: bool) -> None:
        """Show or hide one of PARTS."""
        self._parts[part].visible = shown

    def wear(self, skin: str) -> None:
        """Show the people in one of SKINS."""
        for name, frame in self._skins.items():
            frame.visible = name == skin or (name == "neutral" and skin == "contact")

    def is_shown(self, part: str) -> bool:
        """Whether a part is shown."""
        return bool(self._root.visible and self._parts[part].visible)

    def set_visible(self, shown: bool) -> None:
        """Show or hide the whole result."""
        self._root.visible = shown

    def remove(self) -> None:
        """Remove all nodes of the result."""
        self._root.remove()

    def hit(
        self, origin: NDArray[np.float64], direction: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], int | None] | None:
        """Return the point (3,) that a ray meets, and the person that it is on, if any; None beside everything."""
        offset = self.offset
        sets: list[tuple[NDArray[np.float64], int | None]] = []
        if self.is_shown("people"):
            sets += [(body.vertices, body.index) for body in self.shapes.bodies]
        if self.is_shown("surface"):
            sets.append((self.shapes.surface[0], None))
        if self.is_shown("points"):
            sets.append((self.shapes.points[0], None))
        if not sets:
            return None
        points = np.concatenate([points for points, _ in sets]) + offset
        owner = np.concatenate([np.full(len(p), -1 if index is None else index) for p, index in sets])
        found = nearest_on_ray(points, origin, direction)
        if found is None:
            return None
        return points[found], None if owner[found] < 0 else int(owner[found])
