"""Checks of a ContactPrior: on the bodies' own mesh, higher where they touch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_testing.conformance.answering import CHECKS_OF_PEOPLE
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.rows import check_rows_follow_the_people
from physic_testing.conformance.truth import contact_on_embedded

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]


def check_mesh_is_the_bodies_own(subject: Subject) -> None:
    """`topology` is that of the bodies' mesh, with one probability a vertex; or `rest` gives another mesh."""
    answer, truth = subject.answer(), subject.case("one person").truth
    if answer.rest is not None and answer.topology != truth.topology:
        return
    expect(answer.topology == truth.topology, f"the topology of the bodies, {truth.topology!r}", f"{answer.topology!r}")
    count, wanted = answer.probability.shape[1], truth.vertices.shape[1]
    expect(count == wanted, f"{wanted} vertices of {truth.topology!r}", f"{count}")


def check_mesh_it_brings_is_a_t_pose(subject: Subject) -> None:
    """A mesh in `rest` is a body in the T-pose, in metres, so that contact can be transferred."""
    answer = subject.answer()
    if answer.rest is None:
        return
    from physic_core.errors import BodyModelError

    try:
        contact_on_embedded(answer)
    except BodyModelError as error:
        raise CheckFailed("a mesh in the T-pose: metres, y up, facing +z, its left on +x", str(error)) from error


def check_contact_is_more_likely_where_bodies_touch(subject: Subject) -> None:
    """Vertices that touch have a higher mean probability than the others."""
    answer, truth = subject.answer(), subject.case("one person").truth
    if not truth.contact.any():
        raise CheckSkipped("nobody touches anything")
    if not answer.probability.any():
        raise CheckSkipped("it says nothing of this photo")
    probability = contact_on_embedded(answer).probability
    touching = float(probability[truth.contact].mean())
    others = float(probability[~truth.contact & truth.outer].mean())
    expect(
        touching > others,
        "a higher mean probability where soles touch the floor than elsewhere",
        f"{touching:.2f} there, {others:.2f} elsewhere",
        "1 is contact.",
    )


_READ = "physic_core.types.ContactProbability"
CHECKS: tuple[Check, ...] = (
    *CHECKS_OF_PEOPLE,
    Check(check_mesh_is_the_bodies_own, _READ),
    Check(check_mesh_it_brings_is_a_t_pose, _READ, after=("mesh_is_the_bodies_own",)),
    Check(
        check_contact_is_more_likely_where_bodies_touch,
        _READ,
        after=("mesh_is_the_bodies_own", "mesh_it_brings_is_a_t_pose"),
    ),
    Check(check_rows_follow_the_people, _READ),
)
"""In the order in which they make sense."""
