"""Checks of a ContactPrior: mesh topology, T-pose of the rest mesh, and higher probability at true contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import contact_on_embedded

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]


def check_topology_is_that_of_the_bodies(subject: BackendUnderTest) -> None:
    """Without `rest`, `topology` is that of the input bodies and each vertex has one probability."""
    answer, truth = subject.result(), subject.case("one person").truth
    if answer.rest is not None and answer.topology != truth.topology:
        return
    expect(answer.topology == truth.topology, f"the topology of the bodies, {truth.topology!r}", f"{answer.topology!r}")
    count, wanted = answer.probability.shape[1], truth.vertices.shape[1]
    expect(count == wanted, f"{wanted} vertices of {truth.topology!r}", f"{count}")


def check_rest_mesh_is_a_t_pose(subject: BackendUnderTest) -> None:
    """The mesh in `rest` is a body in the T-pose, in metres, from which contact can be transferred."""
    answer = subject.result()
    if answer.rest is None:
        return
    from physic_core.errors import BodyModelError

    try:
        contact_on_embedded(answer)
    except BodyModelError as error:
        raise CheckFailed("a mesh in the T-pose: metres, y up, facing +z, left side on +x", str(error)) from error


def check_contact_is_more_likely_where_bodies_touch(subject: BackendUnderTest) -> None:
    """Vertices in true contact have a higher mean probability than vertices without contact."""
    answer, truth = subject.result(), subject.case("one person").truth
    if not truth.contact.any():
        raise CheckSkipped("the person touches nothing")
    if not answer.probability.any():
        raise CheckSkipped("all probabilities are 0 for this photo")
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
    *PEOPLE_CHECKS,
    Check(check_topology_is_that_of_the_bodies, _READ),
    Check(check_rest_mesh_is_a_t_pose, _READ, after=("topology_is_that_of_the_bodies",)),
    Check(
        check_contact_is_more_likely_where_bodies_touch,
        _READ,
        after=("topology_is_that_of_the_bodies", "rest_mesh_is_a_t_pose"),
    ),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a ContactPrior, in order of execution."""
