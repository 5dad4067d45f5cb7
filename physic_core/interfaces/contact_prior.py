"""Interface ContactPrior: contact probability of each body vertex."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import (
    check_array,
    check_faces,
    check_limit,
    check_type,
    check_unit_range,
    length,
    rows_to_check,
    valid_rows,
)
from physic_core.interfaces.limits import METRES
from physic_core.types import ContactProbability, RestMesh

if TYPE_CHECKING:
    from physic_core.types import Bodies, BoolArray, People, UInt8Array


@dataclass(frozen=True)
class ContactPriorRequest(Request[ContactProbability]):
    """Input of a ContactPrior: the photo, N people and their bodies.

    Attributes:
        people: N people.
        bodies: of the configured body model, with ``joints`` if that is a file of the user's.
        topology: mesh of ``bodies``, or None to accept any mesh. Not passed to ``infer``.
        vertices: number of vertices of ``topology``. Not passed to ``infer``.
    """

    people: People
    bodies: Bodies
    topology: str | None = field(default=None, kw_only=True)
    vertices: int | None = field(default=None, kw_only=True)


class ContactPrior(Backend):
    """Predicts the contact probability of each body vertex (paper: DECO)."""

    interface = "contact_prior"
    api = 1
    Request = ContactPriorRequest
    Result = ContactProbability

    @abstractmethod
    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Predict the contact probability of each vertex of N bodies.

        The probabilities may be on any mesh. If it is not the mesh of the bodies, give that mesh in the T-pose as
        ``rest``: the core transfers the probabilities. Vertices of 0.5 and more count as in contact.

        Example: people who stand have about 0.9 at the vertices of their soles, and about 0 elsewhere.
        """

    @classmethod
    def check(cls, result: ContactProbability, request: ContactPriorRequest) -> Iterator[str]:
        """Check contact probabilities of N people: in [0, 1], one per vertex of the bodies or of ``result.rest``."""
        vertices, topology = request.vertices, request.topology
        if topology is None or vertices is None:
            vertices = result.probability.shape[-1]
        elif result.topology != topology:
            if result.rest is None:
                yield f"topology must be {topology!r} as the bodies', got {result.topology!r}"
                return
            wrong = list(_check_rest(result.rest, result.topology))
            if wrong:
                yield from wrong
                return
            vertices = len(result.rest.vertices)
        wrong = list(check_array("probability", result.probability, (len(request.people), vertices), "float"))
        yield from wrong or check_unit_range(
            "probability", result.probability[rows_to_check(valid_contact_rows(result))]
        )


def valid_contact_rows(contact: ContactProbability) -> BoolArray:
    """Return (N,) bool: True for people with finite probabilities."""
    return valid_rows([(contact.probability, math.inf)], len(contact.probability))


def _check_rest(rest: RestMesh, topology: str) -> Iterator[str]:
    wrong_type = list(check_type(rest, RestMesh, "rest"))
    if wrong_type:
        yield from wrong_type
        return
    vertices = length(rest.vertices)
    if rest.topology != topology:
        yield f"rest must be the mesh {topology!r} that the probabilities are on, got {rest.topology!r}"
    wrong = list(check_array("rest.vertices", rest.vertices, (vertices, 3), "float"))
    yield from wrong or check_limit("rest.vertices", rest.vertices, METRES, "m")
    yield from check_faces("rest.faces", rest.faces, vertices)
