"""Numbers of each person for the page: stature, distances, and contact by body part."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body import PART_NAMES
from physic_core.geometry import vertex_areas, world_from_camera
from physic_core.types import marks_text, part_words, partner_titles
from physic_visual.palette import contact_color, contact_colors, person_color, person_tint
from physic_visual.rig import body_at_hand
from physic_visual.views import crown

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from physic_core.body import BodyArrays
    from physic_core.types import Float64Array, Person, Reconstruction

# Vertices of all people between which gaps are measured; of a crowd, every n-th.
_MAX_COMPARED = 120_000
_PELVIS = 0
_SPARSE = 32  # every n-th vertex bounds the distance of two people


def people_records(reconstruction: Reconstruction) -> list[dict[str, Any]]:
    """Return the numbers of each person, ready for JSON; a number that is not known is None.

    Returns:
        For each person:

        - ``marks``: which marks are usable, in words.
        - ``why``: sentence on what lowers the probability.
        - ``box``: x0 y0 x1 y1 px, or None if the photo does not show the person.
        - ``color``: of the person's number, sRGB. ``tint``: of the body, sRGB.
        - ``posed``: whether there is a finite body; without one, the distances are None.
        - ``contact_vertices``: number of vertices in contact. ``vertices``: number of vertices.
        - ``contacts``: ``part``, ``partner``, ``color`` sRGB, ``probability``, ``likely``,
          ``assumed``, ``far`` of each.
        - ``support``: sentence on what carries the person.
        - ``stature``: metres. ``stature_sigma``: standard deviation of its logarithm.
        - ``posture``, ``posture_probability``, ``child_probability``: as of
          :class:`physic_core.types.Person`.
        - ``unsure``: arms and legs that are shown and unsure, in words.
        - ``body_source``: what the user gives as the body; "" for an estimated one.
        - ``camera``: distance of the pelvis from the camera, metres. ``distance_sigma``: standard
          deviation of its logarithm.
        - ``pelvis``, ``crown``: (3,) metres, camera frame. ``pelvis_height``: over the floor,
          metres.
        - ``lowest``: height of the lowest vertex over the floor, metres.
        - ``others``: ``person``, ``pelvis`` and ``gap``, the distances of the pelvises and of the
          surfaces, metres.
        - ``contact``: ``part``, ``cm2``, ``share`` and ``colors`` by body part, where ``colors``
          divides the share by what is touched (``color`` sRGB, ``share``).
    """
    posed = any(person.has_body for person in reconstruction.people)
    body = body_at_hand(reconstruction) if posed else None
    gaps = _people_gaps(reconstruction)
    return [
        _person_record(reconstruction, index, gaps, body)
        for index in range(len(reconstruction.people))
    ]


def _person_record(
    reconstruction: Reconstruction,
    index: int,
    gaps: dict[tuple[int, int], float],
    model: BodyArrays | None,
) -> dict[str, Any]:
    person = reconstruction.people[index]
    posed = person.has_body
    up = world_from_camera(reconstruction.scene.level)[1, :3]
    pelvis = np.asarray(person.joints[_PELVIS], np.float64)
    body = model if posed else None
    return {
        "marks": marks_text(person.marks),
        "why": person.why,
        "box": [float(edge) for edge in person.box] if person.mask.any() else None,
        "color": person_color(index),
        "tint": person_tint(index),
        "posed": posed,
        "contact_vertices": int(np.sum(person.contact)),
        "vertices": len(person.vertices),
        "contacts": _contact_texts(person),
        "support": None if person.support is None else str(person.support),
        "stature": None if body is None else person.stature,
        "stature_sigma": None if body is None else person.stature_sigma,
        "posture": person.posture,
        "posture_probability": person.posture_probability,
        "child_probability": person.child_probability,
        "unsure": ", ".join(map(part_words, person.unsure)),
        "body_source": person.body_source,
        "camera": float(np.linalg.norm(pelvis)) if posed else None,
        "distance_sigma": reconstruction.distance_sigmas[index],
        "pelvis": pelvis.tolist() if posed else None,
        "crown": crown(person, up).tolist() if posed else None,
        **_height_fields(reconstruction, person),
        "others": _other_people_records(reconstruction, index, gaps),
        "contact": None if body is None else _contact_areas_by_part(reconstruction, person, body),
    }


def _other_people_records(
    reconstruction: Reconstruction, index: int, gaps: dict[tuple[int, int], float]
) -> list[dict[str, Any]]:
    people = reconstruction.people
    pelvis = np.asarray(people[index].joints[_PELVIS], np.float64)
    return [
        {
            "person": other,
            "pelvis": float(np.linalg.norm(pelvis - people[other].joints[_PELVIS])),
            "gap": gap,
        }
        for (first, other), gap in gaps.items()
        if first == index
    ]


def _contact_texts(person: Person) -> list[dict[str, Any]]:
    titles = partner_titles(contact.partner for contact in person.contacts)
    return [
        {
            "part": part_words(contact.part),
            "partner": titles[contact.partner],
            "color": contact_color(contact.partner),
            "probability": contact.probability,
            "likely": contact.likely,
            "assumed": contact.assumed,
            "far": contact.far,
        }
        for contact in person.contacts
    ]


def _height_fields(reconstruction: Reconstruction, person: Person) -> dict[str, Any]:
    """Return the heights of pelvis and lowest vertex over the floor, metres; None without a floor
    or a body.
    """
    floor = reconstruction.scene.floor
    if floor is None or not person.has_body:
        return {"pelvis_height": None, "lowest": None}
    normal = np.asarray(floor.normal, np.float64)
    length = float(np.linalg.norm(normal))
    return {
        "pelvis_height": float(person.joints[_PELVIS] @ normal + floor.offset) / length,
        "lowest": float((person.vertices @ normal).min() + floor.offset) / length,
    }


def _people_gaps(reconstruction: Reconstruction) -> dict[tuple[int, int], float]:
    """Return the least distance between the vertices of each ordered pair of people with a body,
    metres.
    """
    from scipy.spatial import cKDTree

    posed = [index for index, person in enumerate(reconstruction.people) if person.has_body]
    total = sum(len(reconstruction.people[index].vertices) for index in posed)
    stride = max(1, -(-total // _MAX_COMPARED))
    points = {
        index: np.asarray(reconstruction.people[index].vertices[::stride], np.float64)
        for index in posed
    }
    trees = {index: cKDTree(points[index]) for index in posed}
    gaps: dict[tuple[int, int], float] = {}
    for first, second in combinations(posed, 2):
        gap = _least_distance(trees[first], points[first], points[second])
        gaps[first, second] = gaps[second, first] = gap
    return gaps


def _least_distance(tree: cKDTree, first: Float64Array, second: Float64Array) -> float:
    """Return the least distance of two sets of points, the first of them in the tree."""
    bound = float(tree.query(second[::_SPARSE])[0].min())
    near = ((second >= first.min(0) - bound) & (second <= first.max(0) + bound)).all(1)
    return min(
        bound, float(tree.query(second[near], distance_upper_bound=bound)[0].min(initial=bound))
    )


def _contact_areas_by_part(
    reconstruction: Reconstruction, person: Person, model: BodyArrays
) -> list[dict[str, Any]]:
    """Return name, area in cm2, share and colours of each body part in contact, the largest area
    first.
    """
    area = vertex_areas(person.vertices, reconstruction.faces)
    part = model.part_of_vertex
    painted = contact_colors(person, reconstruction.contact_partners)
    # One number for each colour: rows take ten times as long.
    _, first, color = np.unique(
        painted @ np.array([1 << 16, 1 << 8, 1]), return_index=True, return_inverse=True
    )
    colors = painted[first]
    cell = part * len(colors) + color
    count = len(PART_NAMES)
    touching = np.bincount(cell, area * person.contact, count * len(colors)).reshape(count, -1)
    share = touching / np.maximum(np.bincount(part, area, count), 1e-12)[:, None]
    rows = [
        {
            "part": part_words(name),
            "cm2": 1e4 * float(touching[i].sum()),
            "share": float(share[i].sum()),
            "colors": [
                {"color": colors[k].tolist(), "share": float(share[i, k])}
                for k in np.flatnonzero(touching[i])
            ],
        }
        for i, name in enumerate(PART_NAMES)
        if touching[i].sum() > 5e-5  # half a square centimetre
    ]
    return sorted(rows, key=lambda row: -float(row["cm2"]))
