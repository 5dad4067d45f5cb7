"""Checks of a ContactPrior: on the bodies' own mesh, higher where they touch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.testing.conformance.answering import CHECKS_OF_PEOPLE
from physic_core.testing.conformance.expect import NotJudged, expect
from physic_core.testing.conformance.rows import check_rows_follow_the_people
from physic_core.testing.conformance.run import Check

if TYPE_CHECKING:
    from physic_core.testing.conformance.subject import Subject

__all__ = ["CHECKS"]


def check_mesh_is_the_bodies_own(subject: Subject) -> None:
    """`topology` is that of the bodies' mesh, and there is one probability a vertex."""
    answer, truth = subject.answer(), subject.case("one person").truth
    expect(answer.topology == truth.topology, f"the topology of the bodies, {truth.topology!r}", f"{answer.topology!r}")
    count, wanted = answer.probability.shape[1], truth.vertices.shape[1]
    expect(count == wanted, f"{wanted} vertices of {truth.topology!r}", f"{count}")


def check_contact_is_more_likely_where_bodies_touch(subject: Subject) -> None:
    """Vertices that touch have a higher mean probability than the others."""
    answer, truth = subject.answer(), subject.case("one person").truth
    if not truth.contact.any():
        raise NotJudged("nobody touches anything")
    touching = float(answer.probability[truth.contact].mean())
    others = float(answer.probability[~truth.contact & truth.outer].mean())
    if not answer.probability.any():
        raise NotJudged("it says nothing of this photo")
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
    Check(check_contact_is_more_likely_where_bodies_touch, _READ, after=("mesh_is_the_bodies_own",)),
    Check(check_rows_follow_the_people, _READ),
)
"""In the order in which they make sense."""
