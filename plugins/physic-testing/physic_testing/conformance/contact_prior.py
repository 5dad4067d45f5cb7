"""Checks of a ContactPrior: on the bodies' own mesh, higher where they touch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_testing.conformance.answering import CHECKS_OF_PEOPLE
from physic_testing.conformance.expect import NotJudged, NotMet, expect
from physic_testing.conformance.rows import check_rows_follow_the_people
from physic_testing.conformance.run import Check

if TYPE_CHECKING:
    from physic_core.types import ContactProbability
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS", "on_the_bodies"]


def check_mesh_is_the_bodies_own(subject: Subject) -> None:
    """`topology` is that of the bodies' mesh, with one probability a vertex; or it brings its mesh along."""
    answer, truth = subject.answer(), subject.case("one person").truth
    if answer.rest is not None and answer.topology != truth.topology:
        return
    expect(answer.topology == truth.topology, f"the topology of the bodies, {truth.topology!r}", f"{answer.topology!r}")
    count, wanted = answer.probability.shape[1], truth.vertices.shape[1]
    expect(count == wanted, f"{wanted} vertices of {truth.topology!r}", f"{count}")


def check_mesh_it_brings_is_a_t_pose(subject: Subject) -> None:
    """A mesh that it brings along is a body in the T-pose, in metres, so that contact can be carried over."""
    answer = subject.answer()
    if answer.rest is None:
        return
    from physic_core.errors import BodyModelError

    try:
        on_the_bodies(answer)
    except BodyModelError as error:
        raise NotMet("a mesh in the T-pose: metres, y up, facing +z, its left on +x", str(error)) from error


def check_contact_is_more_likely_where_bodies_touch(subject: Subject) -> None:
    """Vertices that touch have a higher mean probability than the others."""
    answer, truth = subject.answer(), subject.case("one person").truth
    if not truth.contact.any():
        raise NotJudged("nobody touches anything")
    if not answer.probability.any():
        raise NotJudged("it says nothing of this photo")
    probability = on_the_bodies(answer).probability
    touching = float(probability[truth.contact].mean())
    others = float(probability[~truth.contact & truth.outer].mean())
    expect(
        touching > others,
        "a higher mean probability where soles touch the floor than elsewhere",
        f"{touching:.2f} there, {others:.2f} elsewhere",
        "1 is contact.",
    )


def on_the_bodies(answer: ContactProbability) -> ContactProbability:
    """Contact on the mesh of the worlds' bodies."""
    from physic_core.body import load_body
    from physic_core.body.conversion import contact_to_model

    return contact_to_model(answer, load_body("embedded"))


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
