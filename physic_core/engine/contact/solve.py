"""Stage 4: which vertices touch, what they touch, and what supports each person (sec. 3.3)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.body_parts import SEAT, contact_regions
from physic_core.engine.contact.distances import (
    HAND_BREADTH_M,
    KINDS,
    ContactSurfaces,
    Distances,
    SkinDistances,
    dent_depths,
    surface_distances,
)
from physic_core.engine.contact.method import ContactStageMethod, Touch
from physic_core.engine.contact.partner import (
    HIDDEN,
    HIDDEN_SEAT,
    MIN_VERTICES,
    TouchInPhoto,
    assign_partners,
    body_contacts,
)
from physic_core.engine.contact.parts import FACES_UP, scene_parts
from physic_core.engine.contact.probability import (
    contact_part_masks,
    hidden_parts,
    is_lying,
    values_by_vertex,
)
from physic_core.engine.contact.support import (
    PersonContact,
    PersonSupport,
    find_support,
    support_record,
)
from physic_core.engine.contact.surface_in_photo import PeopleInPhoto
from physic_core.engine.skin_contact import (
    SkinContact,
    find_skin_contacts,
    touch_with_skin_contacts,
)
from physic_core.engine.state import Contact, Estimates, State
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.pixels import select_pixels
from physic_core.geometry.tensors import tensors
from physic_core.types.observations import LEAST_PROBABILITY
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types.contacts import Support

_SCENE, _PERSON, _OWN_BODY, _OBJECT = range(len(KINDS))
_TOUCHING = {"foot": "sole", "hand": "hand"}  # contact set of a limb


def solve_contact(estimates: Estimates, state: State, method: ContactStageMethod) -> State:
    """Return the state with the contact of all people; those with non-finite vertices touch
    nothing.
    """
    photo = estimates.photo
    bodies = state.vertices[state.finite_people]
    surfaces = method.surfaces(state.surroundings, bodies, state.unapplied_scene_scale)
    # unknown where inpainted
    (labels,) = select_pixels(state.scene.valid, torch.where(photo.hole, -1, photo.labels))
    near = measure_distances(state, surfaces, (photo.label_names, labels), method)
    return replace(state, contact=find_contact(state, near, method, PeopleInPhoto.of(photo, state)))


def find_contact(
    state: State,
    near: Distances,
    method: ContactStageMethod,
    photo_people: PeopleInPhoto | None = None,
) -> Contact:
    """Return the contact of people by their distances, and by what the picture shows beside
    them.
    """
    if state.observed_touch is not None:
        observed = touch_with_skin_contacts(state.observed_touch, near.skin_contacts)
        state = replace(state, observed_touch=observed)
    touch = _add_unknown_contacts(state, near, method.find_touch(state, near))
    person_supports = _find_supports(state, near, touch, method)
    touch = _add_hidden_contacts(state, near, touch, person_supports)
    return _describe_contacts(state, near, touch, person_supports, photo_people)


def measure_distances(
    state: State,
    surfaces: ContactSurfaces,
    classes: tuple[tuple[str, ...], Tensor],
    method: ContactStageMethod,
) -> Distances:
    """Measure the distances to scene, floor and skin.

    Args:
        state: with the final bodies.
        surfaces: of scene and floor.
        classes: names, and labels (M,) of the points of the scene, see :func:`scene_parts`.
        method: of stage 4.
    """
    model = state.model
    vertices = state.vertices
    scene = surfaces.scene
    normals = vertex_normals(vertices, model.faces)
    free = method.free_vertices(state)
    surface = surface_distances(vertices, surfaces, method.measure, free)
    floor = state.scene.floor
    height = (
        None if floor is None else floor.scaled(state.unapplied_scene_scale).height(scene.points)
    )
    parts = scene_parts(scene, surfaces.row, *classes, height, state.up)
    contacts: tuple[SkinContact, ...] = ()
    if method.people:
        contacts = find_skin_contacts(model, vertices, state.observed_touch)
    people, own = (
        SkinDistances.of_contacts(
            vertices, [one for one in contacts if (one.other == one.person) is is_own]
        )
        for is_own in (False, True)
    )
    return Distances(normals, surface, parts, people, own, contacts)


def _find_supports(
    state: State, near: Distances, touch: Touch, method: ContactStageMethod
) -> tuple[PersonSupport | None, ...]:
    """Return the support of each person; None for people with non-finite vertices."""
    normal_below = near.normals[near.people_skin.person, near.people_skin.vertex] @ state.up
    # a lap carries, a neighbour's thigh does not
    beside = (touch.kind == _PERSON) & (normal_below < FACES_UP)
    outward = (touch.kind >= 0) & (touch.kind != _OWN_BODY) & (touch.kind != _OBJECT) & ~beside
    # the pose leaves a gap only to floor and scene, which do not move
    height = torch.where(touch.kind == _SCENE, near.surface.nearest, 0.0)
    height = torch.where(touch.kind >= 0, height, torch.inf)
    on_visible_limb = state.visible_vertices & (touch.kind != HIDDEN)
    lies = is_lying(state).tolist()
    supports: list[PersonSupport | None] = []
    for i, finite in enumerate(state.finite_people.tolist()):
        if not finite:
            supports.append(None)
            continue
        person = PersonContact(
            vertices=state.vertices[i],
            normals=near.normals[i],
            contact=outward[i],
            on_visible_limb=on_visible_limb[i],
            feet=_limb_pair_touches(touch, "foot", i),
            sits=bool(touch.part_probability)
            and float(touch.part_probability[SEAT][i]) >= LEAST_PROBABILITY,
            lies=lies[i],
            grips=_limb_pair_touches(touch, "hand", i),
            height=height[i],
        )
        supports.append(find_support(state.model, person, state.up, assume=method.assume_supports))
    return tuple(supports)


def _limb_pair_touches(touch: Touch, limb: str, person: int) -> Tensor | None:
    """Return whether the left and the right limb of a person probably touch the scene, (2,) bool;
    None if unknown.
    """
    if not touch.part_probability:
        return None
    return (
        torch.stack([touch.part_probability[f"{side}_{limb}"][person] for side in SIDES])
        >= LEAST_PROBABILITY
    )


def _carried_limbs(state: State) -> list[tuple[str, Tensor]]:
    """Return the name of each carrier, and the vertices (N, V) bool of limbs that it carries: feet
    on a board; feet, hands and seat of people who ride.
    """
    carried = state.carried
    if carried is None:
        return []
    ridden, board = tensors(carried.ridden[:, None], carried.board[:, None])
    parts = contact_part_masks(state.model)
    feet, hands = (parts[f"left_{limb}"] | parts[f"right_{limb}"] for limb in ("foot", "hand"))
    limbs = feet | hands | parts[SEAT]
    return [
        (name, ((ridden == number) & limbs) | ((board == number) & feet))
        for number, name in enumerate(carried.names)
    ]


def _add_unknown_contacts(state: State, near: Distances, touch: Touch) -> Touch:
    """Add contacts of soles, hands, and skin of other parts that faces down, which probably touch
    the world, and have nothing of it within a hand's breadth: with something unknown. A hidden seat
    is a support.

    If too little skin of such a part faces down to be listed, the pose or the answer is wrong,
    either as probably as the other.
    """
    kind = touch.kind.clone()
    part_probability = {**touch.part_probability}
    down = near.normals @ state.up < -FACES_UP
    for name, skin in contact_part_masks(state.model).items() if touch.part_probability else ():
        if name == SEAT:
            continue
        without_surface = touch.part_probability[name] >= LEAST_PROBABILITY
        without_surface &= touch.gaps[name] > HAND_BREADTH_M
        side, _, limb = name.partition("_")
        if limb in _TOUCHING:
            chosen = state.model.contact_set_mask(f"{side}_{_TOUCHING[limb]}") & state.model.outer
        else:
            chosen = skin & down
            too_little_skin = without_surface & (chosen.sum(1) < MIN_VERTICES)
            part_probability[name] = torch.where(
                too_little_skin, 0.5 * part_probability[name], part_probability[name]
            )
        kind[without_surface[:, None] & chosen] = HIDDEN
    return replace(touch, kind=kind, part_probability=part_probability)


def _add_hidden_contacts(
    state: State, near: Distances, touch: Touch, person_supports: tuple[PersonSupport | None, ...]
) -> Touch:
    """Add contacts of hidden supports, and of buttocks that probably touch the world and nothing
    that is known. All contacts with what is hidden or unknown get the probability of their part.

    If too little skin of the buttocks faces down to be listed, the pose or the answer is wrong,
    either as probably as the other.
    """
    kind = touch.kind.clone()
    part_probability = {**touch.part_probability}
    for i, support in enumerate(person_supports):
        if support is not None:
            kind[i, support.hidden] = torch.where(support.seat[support.hidden], HIDDEN_SEAT, HIDDEN)
    if touch.part_probability:
        seat = contact_part_masks(state.model)[SEAT]
        on_world = (kind == _SCENE) | (kind >= HIDDEN)
        without_surface = (touch.part_probability[SEAT] >= LEAST_PROBABILITY) & ~(
            on_world & seat
        ).any(1)
        faces_down = seat & (near.normals @ state.up < -FACES_UP)
        kind[without_surface[:, None] & faces_down] = HIDDEN_SEAT
        too_little_skin = without_surface & (faces_down.sum(1) < MIN_VERTICES)
        part_probability[SEAT] = torch.where(
            too_little_skin, 0.5 * part_probability[SEAT], part_probability[SEAT]
        )
    probability = touch.probability
    if probability is not None and part_probability:
        by_part = values_by_vertex(state.model, part_probability).to(probability)
        probability = torch.where(kind >= HIDDEN, by_part, probability)
    return replace(touch, kind=kind, probability=probability, part_probability=part_probability)


def _observed_floor(state: State) -> Tensor | None:
    """Return the probability (N, 2) that left and right foot are on the floor, NaN where unknown;
    None if unknown of all. Without a plane, no floor is assumed under feet that nothing shows.
    """
    observed = state.observed_floor
    if observed is None or state.scene.floor is not None:
        return observed
    hidden = hidden_parts(state)
    feet = torch.stack([hidden[f"{side}_foot"] for side in SIDES], 1)
    return torch.where(feet, torch.nan, observed)


def _parts_in_skin_contact(contacts: Sequence[SkinContact], person: int) -> set[str]:
    """Return the body parts of a person that touch skin by the observer."""
    parts = {pair.part for pair in contacts if pair.person == person}
    return parts | {pair.other_part for pair in contacts if pair.other == person}


def _describe_contacts(
    state: State,
    near: Distances,
    touch: Touch,
    person_supports: tuple[PersonSupport | None, ...],
    photo_people: PeopleInPhoto | None,
) -> Contact:
    """Name partners and supports, and list the contacts of each body part."""
    regions = contact_regions(state.model)
    has_floor = state.scene.floor is not None
    photo_touch = TouchInPhoto(
        _carried_limbs(state), _observed_floor(state), photo_people, has_floor
    )
    partners, index = assign_partners(touch.kind, near, regions, state.up, photo_touch)
    dents = torch.where(touch.kind == _SCENE, dent_depths(near.surface, near.parts), torch.nan)
    hidden = hidden_parts(state) if touch.part_probability else {}
    contacts = []
    supports: list[Support | None] = []
    for i, support in enumerate(person_supports):
        probability = None if touch.probability is None else touch.probability[i]
        assumed = {
            name: float(touch.part_probability[name][i])
            for name, by_person in hidden.items()
            if by_person[i]
        }
        list_contacts = partial(
            body_contacts,
            dent=dents[i],
            partners=partners,
            regions=regions,
            assumed=assumed,
            skin_contact_parts=_parts_in_skin_contact(near.skin_contacts, i),
        )
        listed = list_contacts(
            index[i],
            probability,
            gaps={name: float(by_person[i]) for name, by_person in touch.gaps.items()},
            distance_from_people=near.people_skin.distance[i],
            min_probability=LEAST_PROBABILITY,
        )
        contacts.append(listed)
        if support is None:
            supports.append(None)
            continue
        carrying = torch.where(support.contact | support.hidden, index[i], -1)
        supports.append(support_record(support, list_contacts(carrying, None), listed))
    return Contact(
        probability=touch.probability,
        distance=near.surface.nearest,
        partner=index,
        partners=partners,
        contacts=tuple(contacts),
        supports=tuple(supports),
        part_probability=touch.part_probability,
    )
