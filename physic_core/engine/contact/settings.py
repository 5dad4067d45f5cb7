"""Settings of stage 4: what each vertex touches, and what carries each person."""

from __future__ import annotations

from dataclasses import dataclass

from physic_core.engine.bounds import Share

__all__ = ["ContactSettings"]


@dataclass(frozen=True)
class ContactSettings:
    """Settings of stage 4: what each vertex touches, and what carries each person."""

    threshold: Share = 0.35
    """Least probability of a vertex in contact. 0.35 has the best F1 on worlds that took no part in the fit, of limbs
    that the photo shows, and of those that it does not show."""
    skin_threshold: Share = 0.16
    """The same for contact with other people and with the own body, which is less certain. 0.16 has an F1 of .21 there,
    and 0.12 one of .22, with half more vertices on body parts that touch no skin."""
    people: bool = True
    """Contact with other people and with the own body too."""
    objects: bool = True
    """Small objects in hands and on laps are no part of the scene, and people touch them
    (:mod:`physic_core.engine.contact.objects`)."""
    assume_supports: bool = True
    """People whom nothing in the scene carries touch a hidden support, such as a seat or what their hands hold
    (:mod:`physic_core.engine.contact.support`)."""
