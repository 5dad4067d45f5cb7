"""HOT-style JSON: contact of each body part, as polygons in the image, and as areas on the body.

The labels and the layout of ``object`` are those of the dataset HOT (Chen et al., "Detecting Human-Object Contact in
Images", CVPR 2023).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry.mesh import vertex_areas, vertex_normals
from physic_core.visual.rig import body_of_result
from physic_export.coco import png
from physic_export.rle import polygons

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, Person, Reconstruction

__all__ = ["HOT_PARTS", "export_hot", "hot_part_of_vertex"]

HOT_PARTS = (
    *("head", "chest", "back", "leftupperarm", "leftforearm", "lefthand", "rightupperarm", "rightforearm"),
    *("righthand", "butt", "hip", "leftthigh", "leftcalf", "leftfoot", "rightthigh", "rightcalf", "rightfoot"),
)
"""HOT's names of the parts; the semantic id of each is its place, counted from 1."""

_OF_PART = {
    "head": "head",
    "torso": "chest",
    **{
        f"{side}_{part}": f"{side}{hot}"
        for side in ("left", "right")
        for part, hot in (
            *(("upper_arm", "upperarm"), ("lower_arm", "forearm"), ("hand", "hand")),
            *(("upper_leg", "thigh"), ("lower_leg", "calf"), ("foot", "foot")),
        )
    },
}


def export_hot(request: ExportRequest) -> ExportedFiles:
    """Return the JSON and a PNG of the image.

    ``object`` has one entry for each connected region of contact in the image, hidden ones included: soles are under
    the foot. ``people`` has contact by part in vertices, square metres and share of the part's surface. Contact with
    the own body is left out, since HOT has none.
    """
    result = request.result
    parts = hot_part_of_vertex(body_of_result(result, request.body_file))
    objects: list[dict[str, Any]] = []
    people = []
    for index, person in request.chosen():
        touching = _outward_contact(person, result)
        people.append({"person": index, "parts": _contact_by_part(person, touching, result.faces, parts)})
        for part, name in enumerate(HOT_PARTS):
            for outline in polygons(_contact_mask(person, result, touching & (parts == part))):
                x, y = np.round(outline, 2).T.tolist()
                objects.append(
                    {
                        "id": len(objects),
                        "semantic_label": name,
                        "semantic_id": part + 1,
                        "polygon": {"x": x, "y": y},
                        "person": index,
                    }
                )
    document = {
        "imsize": {"width": result.intrinsics.width, "height": result.intrinsics.height},
        "filename": f"{request.stem}.png",
        "object": objects,
        "people": people,
        "parts": {name: part + 1 for part, name in enumerate(HOT_PARTS)},
    }
    text = json.dumps(document, allow_nan=False).encode()
    return ExportedFiles({f"{request.stem}{request.suffix}": text, f"{request.stem}.png": png(result.image)})


def hot_part_of_vertex(model: BodyModel) -> NDArray[np.int64]:
    """Return the part (V,) of each vertex, as an index into HOT_PARTS.

    Limbs and head follow from the skinning weights. The torso is divided in the T-pose: at the height of the first
    spine joint into chest and hip, and by the normal into their rear sides, back and butt.
    """
    output = model(*model.zero_pose())
    vertices, joints = output.vertices[0].numpy(), output.joints[0].numpy()
    backward = vertex_normals(vertices, model.faces.numpy())[:, 2] < -0.3
    number = torch.tensor([HOT_PARTS.index(_OF_PART[name]) for name in model.part_names])
    parts: NDArray[np.int64] = number[model.part_of_vertex].numpy()
    torso = parts == HOT_PARTS.index("chest")
    low = vertices[:, 1] < joints[model.joint_names.index("spine1"), 1]
    for chosen, name in (
        (torso & ~low & backward, "back"),
        (torso & low & backward, "butt"),
        (torso & low & ~backward, "hip"),
    ):
        parts[chosen] = HOT_PARTS.index(name)
    parts[model.contact_sets["gluteus"].numpy()] = HOT_PARTS.index("butt")
    return parts


def _outward_contact(person: Person, result: Reconstruction) -> BoolArray:
    """Return the vertices (V,) in contact with anything but the own body."""
    if person.contact_partner is None:
        return person.contact
    own = np.array([*(partner.kind == "self" for partner in result.contact_partners), False])
    found: BoolArray = person.contact & ~own[person.contact_partner]
    return found


def _contact_by_part(
    person: Person, contact: BoolArray, faces: NDArray[np.int32], parts: NDArray[np.int64]
) -> dict[str, dict[str, float | int]]:
    """Return contact of each part that has some: vertices, area and share of the part."""
    area = vertex_areas(person.vertices, faces)
    found = {}
    for part, name in enumerate(HOT_PARTS):
        touching = (parts == part) & contact
        if touching.any():
            found[name] = {
                "vertices": int(touching.sum()),
                "area_m2": round(float(area[touching].sum()), 6),
                "share": round(float(area[touching].sum() / area[parts == part].sum()), 4),
            }
    return found


def _contact_mask(person: Person, result: Reconstruction, contact: BoolArray) -> BoolArray:
    """Return the pixels (H, W) of the faces whose vertices are in contact, seen through the body."""
    import cv2

    camera = result.intrinsics
    mask = np.zeros((camera.height, camera.width), np.uint8)
    touching = contact[result.faces].all(1) & (person.vertices[result.faces][..., 2] > 0.01).all(1)
    points = person.vertices @ camera.matrix.T
    pixels = points[:, :2] / np.where(points[:, 2:] > 0.01, points[:, 2:], 1.0)
    # OpenCV takes fixed-point coordinates: 4 bits are 1/16 px.
    corners = np.round(np.clip(pixels, -4e4, 4e4)[result.faces[touching]] * 16).astype(np.int32)
    for triangle in corners:
        cv2.fillConvexPoly(mask, triangle, 1, shift=4)
    return mask.astype(bool)
