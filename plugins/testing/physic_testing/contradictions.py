"""Contradictions of a result: what it states, and denies elsewhere.

A result without any may be wrong; one with any is wrong somewhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations

import numpy as np

from physic_core import Person, Reconstruction
from physic_core.backends.people import box_iou, mask_iou
from physic_core.judge import CHECKS
from physic_core.types import NO_PARTNER, BodyContact, SupportState

_WORLD = ("floor", "scene", "hidden")
_SAME = 0.8  # overlap of two masks of one person
_LEAST = 0.5  # probability of what is listed
_ROUNDING = 0.01


def contradictions(result: Reconstruction) -> list[str]:
    """Return a sentence for each statement of a result that another one denies."""
    sentences = [*_of_sentences(result), *_of_people(result)]
    for index, person in enumerate(result.people):
        rules = (_of_checks, _of_contacts, _of_support, _of_body)
        sentences += [f"person {index} {text}" for rule in rules for text in rule(result, person)]
    return sentences


def _of_sentences(result: Reconstruction) -> Iterator[str]:
    """Yield what sentences say of people and of a floor who are not there."""
    sentences = [*result.notes, *result.warnings, *(person.why for person in result.people)]
    sentences += [check.message for check in result.checks if check.failed]
    people = len(result.people)
    has_floor = result.scene.floor is not None
    for text in dict.fromkeys(sentences):
        numbers = [int(number) for number in re.findall(r"\bperson (\d+)", text)]
        if numbers and max(numbers) >= people:
            yield f"person {max(numbers)} is not there: {text}"
        counts = [int(number) for number in re.findall(r"\b(\d+) people", text)]
        if counts and max(counts) > people + len(result.unposed):
            yield f"{max(counts)} people are not there: {text}"
        if people < 2 and re.search(r"\bother people\b|\bon which others\b", text):
            yield f"there are no other people: {text}"
        if has_floor and re.search(r"no floor was detected", text):
            yield f"there is a floor: {text}"
        if not has_floor and re.search(r"this floor|upright on the floor|below the floor", text):
            yield f"there is no floor: {text}"
    if len({*result.notes} & {*result.warnings}):
        yield "a note is a warning, too"
    for check in result.checks:
        warned = any(check.message in warning for warning in result.warnings)
        if check.failed and CHECKS[check.name].warns and not warned:
            yield f"check {check.name} failed without a warning"


def _of_people(result: Reconstruction) -> Iterator[str]:
    """Yield who is there twice."""
    for (i, one), (j, other) in combinations(enumerate(result.people), 2):
        if mask_iou(one.mask[None], other.mask[None]) > _SAME:
            yield f"people {i} and {j} have the same pixels"
    for i, person in enumerate(result.people):
        for unposed in result.unposed:
            if (
                "no pose" in unposed.reason
                and box_iou(*np.array([[person.box], [unposed.box]], np.float64)) > _SAME
            ):
                yield f"person {i} has a pose, and the box of one without"


def _of_checks(result: Reconstruction, person: Person) -> Iterator[str]:
    """Yield failed checks that are not named, and marks that they deny."""
    index = next(i for i, one in enumerate(result.people) if one is person)
    checks = [check for check in result.checks if check.person == index]
    failed = [check for check in checks if check.failed]
    if {check.name for check in failed} != {*person.failed_checks}:
        yield "has failed_checks that contradict its checks"
    if {c.name for c in checks if c.value is None} != {*person.unknown_checks}:
        yield "has unknown_checks that contradict its checks"
    if not checks or person.trust is None:
        return
    for check in failed:
        if check.title not in person.why:
            yield f"has the failed check {check.name}, which why does not name"
    if failed and re.search(r"\bno check (fails|lowers)", person.why, re.IGNORECASE):
        yield f"has failed checks, but `why` says that none fails: {person.why}"
    if person.trust > min(value for value in person.marks.values() if value is not None):
        yield "has more trust than the least of its marks"
    for check in result.checks:
        denied = {*CHECKS[check.name].contradicts} & {*person.usable}
        if check.failed and check.person in (None, index) and denied:
            yield f"has the failed check {check.name}, and {', '.join(denied)} usable"
    if len(person.usable) < len(person.marks) and not person.why:
        yield "has doubtful marks, and no reason"


def _of_contacts(result: Reconstruction, person: Person) -> Iterator[str]:
    """Yield contacts with what is not there, with themselves, and of one side alone."""
    index = next(i for i, contact in enumerate(result.people) if contact is person)
    likely_contacts = [contact for contact in person.contacts if contact.likely]
    for contact in person.contacts:
        text = f"{contact.part} on {contact.partner.title}"
        kind = contact.partner.kind
        if kind == "floor" and result.scene.floor is None:
            yield f"touches a floor that is not found: {text}"
        if kind == "self" and contact.partner.part == contact.part:
            yield f"touches a part with itself: {text}"
        if contact.assumed and "_" in contact.part and contact.part not in person.unseen:
            yield f"has an assumed contact of a part that is seen: {text}"
        if not contact.assumed and contact.part in person.unseen:
            yield f"has a contact of an unseen part that is not called assumed: {text}"
        if kind == "person" and contact.partner.person not in {*range(len(result.people))} - {
            index
        }:
            yield f"touches a person who is not there: {text}"
        elif kind == "person" and contact.likely and not _is_returned(result, index, contact):
            yield f"touches a person without being touched back: {text}"
    pairs = [(contact.part, contact.partner) for contact in person.contacts]
    if len({*pairs}) < len(pairs):
        yield "has a contact twice"
    for part, probability in (person.world_contact or {}).items():
        listed = [
            contact.probability or 0.0
            for contact in likely_contacts
            if contact.part == part and contact.partner.kind in _WORLD
        ]
        if listed and max(listed) > probability + _ROUNDING:
            yield f"touches the world with {part} by {max(listed):.2f}, and by {probability:.2f}"
        if not listed and probability >= _LEAST + _ROUNDING:
            yield f"touches the world with {part} by {probability:.2f}, which is not listed"


def _is_returned(result: Reconstruction, index: int, contact: BodyContact) -> bool:
    """Return whether the touched person of a contact lists the touching one."""
    assert contact.partner.person is not None
    return any(
        other.partner.person == index and other.part == contact.partner.part
        for other in result.people[contact.partner.person].contacts
    )


def _of_support(result: Reconstruction, person: Person) -> Iterator[str]:
    """Yield a support that contacts deny, and a gap beside contacts without one."""
    support = person.support
    if support is None:
        return
    on_world = [
        contact for contact in person.contacts if contact.likely and contact.partner.kind in _WORLD
    ]
    if support.state is SupportState.AIRBORNE and on_world:
        yield f"is in the air, and touches {on_world[0]}"
    floats = support.state in (SupportState.UNBALANCED, SupportState.AIRBORNE)
    if not floats and not support.contacts:
        yield f"is {support.state} by no contact"
    listed = {(contact.part, contact.partner) for contact in person.contacts}
    for contact in support.contacts if person.world_contact else ():
        if contact.partner.kind != "hidden" and (contact.part, contact.partner) not in listed:
            yield f"is carried by a contact that is not listed: {contact}"
    gap = person.measures.clearance_m or 0.0
    near = [
        contact
        for contact in on_world
        if contact.partner.in_scene and contact.distance_m is None and not contact.assumed
    ]
    if gap > 0.1 and near and "support" in person.failed_checks:
        yield f"is {gap:.2f} m off any surface, and touches {near[0]}"


def _of_body(result: Reconstruction, person: Person) -> Iterator[str]:
    """Yield numbers of who has no body, and numbers that deny each other."""
    if not person.has_body and (
        person.contacts or person.stature is not None or person.usable or person.sizes
    ):
        yield "has no body, and numbers of one"
    if bool(person.sizes) != (person.has_body and result.scene.floor is not None):
        yield "has heights over a floor that is not there, or none over one that is"
    if (person.posture is None) != (person.posture_probability is None):
        yield "has a posture without a probability, or the reverse"
    if bool(person.unsure) != ("limb_sigma" in person.failed_checks):
        yield "has unsure limbs without the failed check of limbs, or the reverse"
    partner = person.contact_partner
    if partner is not None and ((partner != NO_PARTNER) != person.contact).any():
        yield "has vertices in contact with nothing, or the reverse"
