"""GLB files: bodies with skeleton and pose, contact, scene, floor and camera; metres, y up.

The scene is textured with the photo without people, and unlit, since a photo contains its own
light. So is the backdrop, a part of a sphere that shows what is farther. So are people; what no
photo shows of them is guessed, and darker. Variants of their material (KHR_materials_variants) are
plain, and show contact, which is an attribute of their vertices too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.errors import InputError
from physic_core.export import ExportRequest, camera_pose, export_frame
from physic_core.geometry import linear_from_srgb, transform_points
from physic_visual.assumed_supports import SLAB_FACES, assumed_supports
from physic_visual.floor import floor_rectangles
from physic_visual.glb_builder import ARRAY, INDICES, GlbBuilder
from physic_visual.palette import (
    BODY_RGB,
    CONTACT_PALETTE,
    FAINT,
    FLOOR_RGB,
    contact_legend,
    has_faint_contact,
    painted_contact,
)
from physic_visual.rig import Rig, bound_in_pose, rigs
from physic_visual.scene_mesh import BACKDROP, scene_meshes, scene_reach, unit_normals
from physic_visual.textures.dressed import (
    GUESSED,
    dressed_bodies,
    dressed_images,
    image_of_vertices,
)
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core.types import (
        AnyArray,
        Float32Array,
        Float64Array,
        FloatArray,
        Int64Array,
        IntArray,
        Intrinsics,
        Reconstruction,
        UInt8Array,
    )
    from physic_visual.textures.raster import TextureCoordinates

_WEIGHT_LOSS = 1e-3
"""Maximum sum of the weights beyond four influences of a vertex; with more, eight are written."""

SKINS = ("photo", "neutral", "contact")
"""Variants of the material of a person."""

_CONTACT_TEXELS = 256
"""Texels along a side of the picture of contact; one is 7 mm of skin, and vertices are 1 to 2 cm
apart.
"""

_PART_VERTICES = 60_000
"""Vertices of a part of the scene: with the next row of pixels, their indices are of 16 bits."""

_FLOOR_OPACITY = 0.35
_ASSUMED_OPACITY = 0.6


@dataclass(frozen=True)
class Appearance:
    """Material of a mesh, and the vertices of a body that differ from its own.

    Attributes:
        material: its entry in the file.
        primitive: further properties of the primitive.
        mesh: texture coordinates, whose vertices are those of the primitive; None for the body's
            own vertices and faces.
        attributes: name -> (U, ...) further values of the vertices.
        accessors: name -> index of an accessor of the file, with further values of the vertices.
    """

    material: dict[str, Any]
    primitive: Mapping[str, Any] = field(default_factory=dict)
    mesh: TextureCoordinates | None = None
    attributes: Mapping[str, AnyArray] = field(default_factory=dict)
    accessors: Mapping[str, int] = field(default_factory=dict)


def combined_glb(result: Reconstruction) -> bytes:
    """Return the content of ``combined.glb``: bodies bound in the pose of
    the photo, so that readers without skinning show people at their place; also without a body
    model.

    Bodies of SMPL-X files have no skeleton here, and ``extras`` of the scene states why: their
    skinning weights are the user's, and not copied unasked.
    """
    posed = tuple(index for index, person in enumerate(result.people) if person.has_body)
    request = ExportRequest(
        result, posed, export_frame(result.scene.level, "y"), "combined", ".glb"
    )
    skins = dict[int, Rig]()
    reason = ""
    if result.body_model == "embedded":
        try:
            skins = _posed_rigs(request)
        except InputError as error:
            reason = str(error)
    else:
        reason = "your own file has it; `physic export --to glb` writes it"
    return build_glb(request, skins, add_dressed, reason).content()


def _posed_rigs(request: ExportRequest) -> dict[int, Rig]:
    """Return person -> rig whose bind pose is that of the photo."""
    skins = {}
    for index, rig in rigs(request):
        vertices = transform_points(
            request.frame.from_camera, request.result.people[index].vertices
        )
        skins[index] = bound_in_pose(rig, vertices)
    return skins


def glb_notes(request: ExportRequest, skins: Mapping[int, Rig]) -> tuple[str, ...]:
    """Return sentences about what a GLB file of a request cannot state."""
    notes = []
    for index, rig in skins.items():
        lost = float(1 - skin_influences(rig.weights)[1].sum(1).min())
        if lost > _WEIGHT_LOSS:
            notes.append(
                f"person {index}: skinning weights beyond eight joints are skipped (at most "
                f"{lost:.3f})"
            )
    camera = request.result.intrinsics
    offset = math.dist(((camera.width - 1) / 2, (camera.height - 1) / 2), (camera.cx, camera.cy))
    if offset > 1.0:
        notes.append(
            f"the principal point is {offset:.0f} px from the image center, which a glTF camera "
            "cannot state: a render of the camera is shifted by that"
        )
    return tuple(notes)


def body_material(
    name: str, rgb: tuple[int, int, int] | None = None, texture: int | None = None
) -> dict[str, Any]:
    """Return a matte material with an sRGB colour or the index of a texture."""
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
    if rgb is not None:
        surface["baseColorFactor"] = [
            *linear_from_srgb(np.array(rgb, np.uint8)).round(4).tolist(),
            1.0,
        ]
    if texture is not None:
        surface["baseColorTexture"] = {"index": texture}
    return {"name": name, "pbrMetallicRoughness": surface}


def photo_appearance(
    glb: GlbBuilder,
    name: str,
    photo: bytes,
    contact: tuple[bytes, str],
    mesh: TextureCoordinates,
    photo_share: float,
    skin: str = SKINS[0],
) -> Appearance:
    """Add the textures of a person, and return its materials as variants, and the texture
    coordinates.

    Args:
        glb: the file.
        name: of the person.
        photo: texture with the photo's colours, JPEG.
        contact: texture of contact, and its MIME type.
        mesh: texture coordinates.
        photo_share: share of the body that the photo shows.
        skin: the variant of :data:`SKINS` that is shown by programs that do not know variants.
    """
    material = body_material(name, texture=glb.add_texture(photo, "image/jpeg", name))
    material |= {
        "extensions": {"KHR_materials_unlit": {}},
        "extras": {"share_from_photo": round(photo_share, 4)},
    }
    picture = glb.add_texture(*contact, f"{name}_contact")
    materials = (
        material,
        body_material("body", BODY_RGB),
        body_material(f"{name}_contact", texture=picture),
    )
    mappings = [
        {"material": glb.add_material(one), "variants": [number]}
        for number, one in enumerate(materials)
    ]
    uv = np.stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]], 1)
    return Appearance(
        materials[SKINS.index(skin)],
        {"extensions": {"KHR_materials_variants": {"mappings": mappings}}},
        mesh,
        {"TEXCOORD_0": uv},
    )


def add_dressed(glb: GlbBuilder, index: int, request: ExportRequest) -> Appearance:
    """Return a body in the photo's colours and guessed ones; without a texture, vertices have
    colours.
    """
    dressed = dressed_bodies(request.result)
    name = f"person_{index}"
    person = request.result.people[index]
    if dressed.mesh is not None:
        touched = painted_contact(person, request.result.contact_partners)
        contact = encode_image(image_of_vertices(touched, "embedded", _CONTACT_TEXELS), "JPEG")
        photo = encode_image(dressed_images(request.result)[index], "JPEG")
        return photo_appearance(
            glb,
            name,
            photo,
            (contact, "image/jpeg"),
            dressed.mesh,
            dressed.people[index].shown_share,
        )
    linear = np.ones((len(person.vertices), 4))
    linear[:, :3] = linear_from_srgb(dressed.people[index].colors)
    colors = glb.add_accessor(np.round(65535 * linear).astype(np.uint16), ARRAY, normalized=True)
    white = body_material("photo_colors") | {"extensions": {"KHR_materials_unlit": {}}}
    return Appearance(white, accessors={"COLOR_0": colors})


def build_glb(
    request: ExportRequest,
    skins: Mapping[int, Rig],
    make_appearance: Callable[[GlbBuilder, int, ExportRequest], Appearance],
    reason: str = "",
) -> GlbBuilder:
    """Return a GLB file of the people of a request.

    Args:
        request: of any up axis.
        skins: person -> rig, of those that get a skeleton.
        make_appearance: called with the file, to which it can add textures, and the person.
        reason: why others get no skeleton.
    """
    glb = GlbBuilder(generator="PhySIC")
    result = request.result
    frame = request.frame
    nodes: list[int] = []
    if request.scene:
        nodes += _add_scene(glb, request)
        nodes += _add_floor(glb, request)
        nodes += _add_assumed(glb, request)
    for index in request.person:
        nodes += _add_person(
            glb, index, request, skins.get(index), make_appearance(glb, index, request)
        )
    nodes.append(_add_camera(glb, result.intrinsics, camera_pose(frame)))
    extras = {
        "units": "meters",
        "axes": frame.axes,
        "world_from_camera": frame.from_camera.tolist(),
        "body_model": result.body_model,
        "contact": "vertex attribute _CONTACT: 1 in contact, 0 not",
        "contact_colors": contact_legend(result),
    }
    if make_appearance is add_dressed and request.person:
        extras["colors_of_people"] = f"those of the photo; {GUESSED}"
        if has_faint_contact(result):
            extras["contact_variant"] = FAINT
    if skins:
        extras["rest_pose"] = "T-pose at zero rotations of the joints"
        if make_appearance is add_dressed:
            extras["bind_pose"] = "that of the photo"
    if reason:
        extras["no_skeleton"] = reason
    glb.tree["scenes"] = [{"name": "physic", "nodes": nodes, "extras": extras}]
    glb.tree["scene"] = 0
    if any(
        "KHR_materials_unlit" in material.get("extensions", ())
        for material in glb.tree.get("materials", ())
    ):
        _use_extension(glb, "KHR_materials_unlit")
    if any("extensions" in mesh["primitives"][0] for mesh in glb.tree.get("meshes", ())):
        _use_extension(glb, "KHR_materials_variants")
        glb.tree["extensions"] = {
            "KHR_materials_variants": {"variants": [{"name": skin} for skin in SKINS]}
        }
    return glb


def _use_extension(glb: GlbBuilder, extension: str) -> None:
    glb.tree["extensionsUsed"] = sorted({*glb.tree.get("extensionsUsed", ()), extension})


def skin_influences(
    weights: FloatArray,
) -> tuple[UInt8Array, Float32Array]:
    """Return joints and weights (V, 4) or (V, 8) of each vertex: the largest, normalised if little
    was lost.

    Eight are used if more than 0.001 of a vertex lies beyond four. A joint of weight 0 is 0, as
    glTF demands.
    """
    order = np.argsort(-weights, axis=1, kind="stable")
    ranked = np.take_along_axis(weights, order, 1)
    count = 4 if (1 - ranked[:, :4].sum(1)).max() <= _WEIGHT_LOSS else 8
    kept = ranked[:, :count] / ranked[:, :count].sum(1, keepdims=True)
    kept = kept.astype(np.float32)
    return np.where(kept > 0, order[:, :count], 0).astype(np.uint8), kept


def _add_person(
    glb: GlbBuilder, index: int, request: ExportRequest, rig: Rig | None, appearance: Appearance
) -> list[int]:
    """Add mesh of a person, with skin and joints if there is a rig, and return the indices of the
    nodes at the top.
    """
    name = f"person_{index}"
    person = request.result.people[index]
    result = request.result
    faces = np.asarray(result.faces, np.int64)
    vertices = (
        transform_points(request.frame.from_camera, person.vertices)
        if rig is None
        else rig.vertices
    )
    normals = unit_normals(vertices, faces)
    rows: Any = slice(None)
    drawn = faces
    if appearance.mesh is not None:
        rows = appearance.mesh.vertex
        drawn = appearance.mesh.faces
    attributes = {
        "POSITION": glb.add_accessor(vertices.astype(np.float32)[rows], ARRAY, with_bounds=True),
        "NORMAL": glb.add_accessor(normals[rows], ARRAY),
        "_CONTACT": glb.add_accessor(person.contact.astype(np.float32)[rows], ARRAY),
        **{key: glb.add_accessor(values, ARRAY) for key, values in appearance.attributes.items()},
        **appearance.accessors,
    }
    tops = list[int]()
    skin = dict[str, int]()
    if rig is not None:
        top, skin["skin"] = _add_skeleton(glb, name, rig)
        tops.append(top)
        attributes |= _skin_attributes(glb, rig, rows)
    tops.append(_add_mesh(glb, name, attributes, drawn, appearance, **skin))
    return tops


def _skin_attributes(glb: GlbBuilder, rig: Rig, vertices: Any) -> dict[str, int]:
    """Return the accessors of the joints and weights of chosen vertices, four influences each."""
    indices, weights = skin_influences(rig.weights)
    attributes = {}
    for group in range(indices.shape[1] // 4):
        columns = slice(4 * group, 4 * group + 4)
        attributes[f"JOINTS_{group}"] = glb.add_accessor(indices[vertices, columns], ARRAY)
        attributes[f"WEIGHTS_{group}"] = glb.add_accessor(weights[vertices, columns], ARRAY)
    return attributes


def _add_skeleton(glb: GlbBuilder, name: str, rig: Rig) -> tuple[int, int]:
    """Add the joints of a rig in its pose, and return the indices of the node above them and of
    their skin.
    """
    quaternions = Rotation.from_matrix(rig.rotations).as_quat()
    first = len(glb.tree.get("nodes", ()))
    for joint, joint_name in enumerate(rig.names):
        node: dict[str, Any] = {
            "name": joint_name,
            "rotation": quaternions[joint].tolist(),
            "translation": rig.offsets[joint].tolist(),
        }
        children = [first + child for child, parent in enumerate(rig.parents) if parent == joint]
        if children:
            node["children"] = children
        glb.add("nodes", node)
    # A node of its own above each skeleton: Blender makes one armature of skeletons with a common
    # parent.
    top = glb.add("nodes", {"name": f"{name}_skeleton", "children": [first]})
    skin = {
        "name": name,
        "inverseBindMatrices": glb.add_accessor(rig.inverse_bind.astype(np.float32)),
        "joints": list(range(first, top)),
        "skeleton": top,
    }
    return top, glb.add("skins", skin)


def _add_mesh(
    glb: GlbBuilder,
    name: str,
    attributes: dict[str, int],
    faces: IntArray,
    appearance: Appearance,
    **node: int,
) -> int:
    """Add a mesh of faces (F, 3) with the material of a look, and return the index of its node."""
    mesh = glb.add(
        "meshes", {"name": name, "primitives": [_primitive(glb, attributes, faces, appearance)]}
    )
    return glb.add("nodes", {"name": name, "mesh": mesh, **node})


def _primitive(
    glb: GlbBuilder, attributes: dict[str, int], faces: IntArray, appearance: Appearance
) -> dict[str, Any]:
    indices = glb.add_accessor(
        faces.reshape(-1).astype(np.uint16 if faces.max() < 65535 else np.uint32), INDICES
    )
    return {
        "attributes": attributes,
        "indices": indices,
        "material": glb.add_material(appearance.material),
        **appearance.primitive,
    }


def _add_scene(glb: GlbBuilder, request: ExportRequest) -> list[int]:
    """Add the textured meshes of scene and backdrop, and return the indices of their nodes; none of
    an empty mesh.
    """
    surface, backdrop = scene_meshes(request.result)
    meshes = {"scene": surface, "backdrop": backdrop}
    if not any(len(mesh.faces) for mesh in meshes.values()):
        return []
    _use_extension(glb, "KHR_materials_unlit")
    colors = request.result.scene.colors
    jpeg = encode_image(colors, "JPEG")
    photo = body_material("photo", texture=glb.add_texture(jpeg, "image/jpeg", "photo"))
    photo |= {"extensions": {"KHR_materials_unlit": {}}}
    nodes = []
    for name, mesh in meshes.items():
        if len(mesh.faces):
            vertices = transform_points(request.frame.from_camera, mesh.vertices).astype(np.float32)
            uv = ((mesh.pixels + 0.5) / colors.shape[1::-1]).astype(np.float32)
            # From outside, the backdrop must not hide what is before it.
            look = Appearance(photo | {"name": name, "doubleSided": mesh is surface})
            primitives = _primitives_in_parts(glb, vertices, uv, mesh.faces, look)
            entry = glb.add("meshes", {"name": name, "primitives": primitives})
            nodes.append(glb.add("nodes", {"name": name, "mesh": entry}))
    if len(backdrop.faces):
        glb.tree["nodes"][nodes[-1]]["extras"] = {
            "meaning": BACKDROP,
            "radius_m": round(scene_reach(request.result), 3),
        }
    return nodes


def _primitives_in_parts(
    glb: GlbBuilder,
    vertices: Float32Array,
    places: Float32Array,
    faces: Int64Array,
    appearance: Appearance,
) -> list[dict[str, Any]]:
    """Return primitives of faces (F, 3) with texture coordinates ``places``, whose indices are
    small.
    """
    primitives = []
    first = faces.min(1)
    for start in range(0, len(vertices), _PART_VERTICES):
        part = faces[(start <= first) & (first < start + _PART_VERTICES)]
        if len(part):
            rows = slice(start, part.max() + 1)
            attributes = {
                "POSITION": glb.add_accessor(vertices[rows], ARRAY, with_bounds=True),
                "TEXCOORD_0": glb.add_accessor(places[rows], ARRAY),
            }
            primitives.append(_primitive(glb, attributes, part - start, appearance))
    return primitives


def _add_floor(glb: GlbBuilder, request: ExportRequest) -> list[int]:
    """Add what is drawn of the floor, if there is one, and return the index of its node."""
    floor = floor_rectangles(request.result, request.frame, scene_meshes(request.result)[0])
    if floor is None:
        return []
    vertices, faces = floor
    if not len(faces):
        return [glb.add("nodes", {"name": "floor"})]
    normals = np.broadcast_to(request.frame.up_vector, vertices.shape)
    attributes = {
        "POSITION": glb.add_accessor(vertices.astype(np.float32), ARRAY, with_bounds=True),
        "NORMAL": glb.add_accessor(normals.astype(np.float32), ARRAY),
    }
    return [
        _add_mesh(
            glb, "floor", attributes, faces, Appearance(_glass("floor", FLOOR_RGB, _FLOOR_OPACITY))
        )
    ]


def _glass(name: str, rgb: tuple[int, int, int], opacity: float) -> dict[str, Any]:
    """Return a material that shows what is behind it."""
    material = body_material(name, rgb) | {"doubleSided": True, "alphaMode": "BLEND"}
    material["pbrMetallicRoughness"]["baseColorFactor"][3] = opacity
    return material


def _add_assumed(glb: GlbBuilder, request: ExportRequest) -> list[int]:
    """Add the supports that are assumed for the people of a request, and return the indices of
    their nodes.
    """
    look = Appearance(_glass("assumed", CONTACT_PALETTE["something hidden"], _ASSUMED_OPACITY))
    nodes = []
    for support in assumed_supports(request.result):
        if support.person in request.person:
            corners = transform_points(request.frame.from_camera, support.vertices)[
                SLAB_FACES
            ].reshape(-1, 3)
            triangles = np.arange(len(corners)).reshape(-1, 3)
            attributes = {
                "POSITION": glb.add_accessor(corners.astype(np.float32), ARRAY, with_bounds=True),
                "NORMAL": glb.add_accessor(unit_normals(corners, triangles), ARRAY),
            }
            name = f"{support.name.replace(' ', '_')}_of_person_{support.person}"
            nodes.append(_add_mesh(glb, name, attributes, triangles, look))
    return nodes


def _add_camera(glb: GlbBuilder, camera: Intrinsics, pose: Float64Array) -> int:
    """Add the camera of the photo at a pose (4, 4), and return the index of its node."""
    height = camera.height / camera.fy
    width = camera.width / camera.fx
    perspective = {
        "yfov": 2 * math.atan(height / 2),
        "aspectRatio": width / height,
        "znear": 0.05,
        "zfar": 1000.0,
    }
    entry = {
        "name": "photo",
        "type": "perspective",
        "perspective": perspective,
        "extras": {
            "intrinsics_px": camera.matrix.tolist(),
            "size_px": [camera.width, camera.height],
        },
    }
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
    node = {
        "name": "camera",
        "camera": glb.add("cameras", entry),
        "rotation": quaternion.tolist(),
        "translation": pose[:3, 3].tolist(),
    }
    return glb.add("nodes", node)
