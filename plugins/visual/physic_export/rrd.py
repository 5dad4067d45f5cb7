"""RRD: a recording for Rerun with photo, depth, points, bodies, contact and camera on a
timeline.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry import transform_points
from physic_core.types import usable_text
from physic_export.meshes import person_meshes
from physic_export.skins import skins_of
from physic_visual.scene_mesh import is_near, scene_meshes, scene_reach

if TYPE_CHECKING:
    import rerun as rr

_STEPS = ("photo", "scene", "people", "contact")
"""Steps of the timeline "stage".

A result has the end state of the engine only: nothing moves between them.
"""


def export_rrd(request: ExportRequest) -> ExportedFiles:
    """Return one recording; its entities are in the frame of the request, metres.

    - ``world/camera``: pose and pinhole model; below it the photo, and the depth of the scene in
      metres.
    - ``world/scene``: the points of the scene with the colours of the inpainted photo, up to the
      backdrop.
    - ``world/backdrop``: what is farther, on a part of a sphere: direction only, distance unknown.
    - ``world/person_0``, ...: the bodies, at step "people" in the colours of the option ``skin``,
      at step "contact" in those of what they touch.
    - ``result``: usable marks, warnings and notes as text.
    """
    import rerun as rr

    recording = rr.RecordingStream("physic", recording_id=request.stem)
    stream = recording.binary_stream()
    axes = {"y": rr.ViewCoordinates.RIGHT_HAND_Y_UP, "z": rr.ViewCoordinates.RIGHT_HAND_Z_UP}
    recording.log("world", axes.get(request.frame.up, rr.ViewCoordinates.RDF), static=True)
    recording.log("result", rr.TextDocument(_notes_text(request)), static=True)
    skins = skins_of(request)
    touched = replace(
        skins, request=replace(request, options={**request.options, "skin": "contact"})
    )
    for step, name in enumerate(_STEPS):
        recording.set_time("stage", sequence=step)
        recording.log("stages", rr.TextLog(name))
        if name == "photo":
            _log_photo(recording, request)
        elif name == "scene" and request.scene:
            _log_scene(recording, request)
        elif name in ("people", "contact"):
            for mesh in person_meshes(request, touched if name == "contact" else skins):
                body = rr.Mesh3D(
                    vertex_positions=mesh.vertices,
                    triangle_indices=mesh.faces,
                    vertex_normals=mesh.normals,
                    vertex_colors=mesh.colors,
                )
                recording.log(f"world/{mesh.name}", body)
    return ExportedFiles({f"{request.stem}{request.suffix}": stream.read() or b""}, skins.notes)


def _log_scene(recording: rr.RecordingStream, request: ExportRequest) -> None:
    """Log depth and points of the scene, and the backdrop."""
    import rerun as rr

    scene = request.result.scene
    depth = np.where(scene.valid, scene.points[..., 2], np.nan).astype(np.float32)
    recording.log("world/camera/depth", rr.DepthImage(depth, meter=1.0))
    near = scene.valid & is_near(scene.points, scene_reach(request.result))
    matrix = request.frame.from_camera
    points = transform_points(matrix, scene.points[near])
    recording.log("world/scene", rr.Points3D(points, colors=scene.colors[near]))
    _, backdrop = scene_meshes(request.result)
    if len(backdrop.faces):
        shell = rr.Mesh3D(
            vertex_positions=transform_points(matrix, backdrop.vertices),
            triangle_indices=backdrop.faces,
            vertex_texcoords=(backdrop.pixels + 0.5) / scene.valid.shape[::-1],
            albedo_texture=scene.colors,
        )
        recording.log("world/backdrop", shell)


def _log_photo(recording: rr.RecordingStream, request: ExportRequest) -> None:
    import rerun as rr

    result = request.result
    pose = request.frame.from_camera
    camera = result.intrinsics
    matrix = np.array(result.intrinsics.matrix)
    matrix[:2, 2] += 0.5  # Rerun counts from the corner of a pixel, not from its centre
    recording.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
    pinhole = rr.Pinhole(image_from_camera=matrix, resolution=(camera.width, camera.height))
    recording.log("world/camera", pinhole)
    recording.log("world/camera/photo", rr.Image(result.image).compress())


def _notes_text(request: ExportRequest) -> str:
    result = request.result
    return "\n".join(
        (
            usable_text(result.usable, len(result.people)),
            repr(result),
            *result.warnings,
            *result.notes,
        )
    )
