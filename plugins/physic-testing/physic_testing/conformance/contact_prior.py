"""Checks of a ContactPrior: mesh topology, T-pose of the rest mesh, and higher probability at true contacts."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.bias import MIN_UNITS, expect_no_better
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import contact_on_embedded, embedded_body

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest

_ROUNDING = 1e-6  # of the mean of one probability over many vertices


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
    """Over several photos, vertices in true contact have a higher mean probability than vertices without contact."""
    outer = embedded_body().outer.numpy()
    people = _people(subject)
    touching, others = (
        float(np.mean([likely[outer & (truth == contact)].mean() for likely, truth in people])) for contact in (1, 0)
    )
    expect(
        touching > others + _ROUNDING,
        "a higher mean probability where bodies touch than elsewhere",
        f"{touching:.2f} there, {others:.2f} elsewhere",
        "1 is contact, and probabilities are in the order of the vertices.",
    )


def check_vertices_are_in_order(subject: BackendUnderTest) -> None:
    """The probabilities are not mirrored, and not those of vertices with other numbers."""
    people = _people(subject)
    moved = int(np.argmax(sum(_circular_fit(likely, truth) for likely, truth in people)))
    readings: dict[str, Callable[[FloatArray], FloatArray]] = {
        "mirrored": lambda likely: likely[_mirrored_vertices()],
        "in reverse order": lambda likely: likely[::-1],
        "moved to other vertices": lambda likely: np.roll(likely, -moved),
    }
    expect_no_better(
        np.array([_ranking_error(likely, truth) for likely, truth in people]),
        {
            words: np.array([_ranking_error(reading(likely), truth) for likely, truth in people])
            for words, reading in readings.items()
        },
        0.003,
        "probabilities in the order of the vertices, share of pairs of vertices that are ranked wrongly",
        {
            "mirrored": "Was the photo mirrored for the network?",
            "moved to other vertices": f"They fit {moved} numbers earlier: do they begin at another vertex?",
        },
    )


def _people(subject: BackendUnderTest) -> list[tuple[FloatArray, FloatArray]]:
    """Return probabilities (V,) on the embedded body and true contact (V,), 0 or 1, of people who have both.

    Raises:
        CheckSkipped: too few.
    """
    found = [
        (likely, truth.astype(np.float64))
        for case, answer in subject.evidence()
        for likely, truth in zip(contact_on_embedded(answer).probability, case.truth.contact, strict=True)
        if likely.std() > 0 and truth.any()
    ]
    if len(found) < MIN_UNITS:
        raise CheckSkipped(f"{len(found)} people have contact and probabilities, {MIN_UNITS} are needed")
    return found


def _ranking_error(likely: FloatArray, truth: FloatArray) -> float:
    """Return the share of pairs of an outer vertex in contact and one without of which the first has the lower value.

    Equal values count half.
    """
    from scipy.stats import rankdata

    outer = embedded_body().outer.numpy()
    ranks, touching = rankdata(likely[outer]), truth[outer] > 0
    count, others = int(touching.sum()), int((~touching).sum())
    return 1 - float(ranks[touching].sum() - count * (count + 1) / 2) / (count * others)


def _circular_fit(likely: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the covariance (V,) of probabilities with the truth, for each number of vertices they may be moved by."""
    spectra = (np.fft.rfft(values - values.mean()) for values in (likely, truth))
    fit: FloatArray = np.fft.irfft(next(spectra) * next(spectra).conj(), len(likely)) / max(float(likely.std()), 1e-9)
    return fit


@lru_cache(maxsize=1)
def _mirrored_vertices() -> IntArray:
    """Return for each vertex of the embedded body (V,) the nearest one on the other side of the T-pose."""
    from scipy.spatial import cKDTree

    from physic_core.body.convert.bodies import rest_mesh_of_model

    vertices = rest_mesh_of_model(embedded_body()).vertices
    found: IntArray = cKDTree(vertices).query(vertices * [-1, 1, 1])[1]
    return found


_READ = "physic_core.types.ContactProbability"
_MESH = ("topology_is_that_of_the_bodies", "rest_mesh_is_a_t_pose")
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_topology_is_that_of_the_bodies, _READ),
    Check(check_rest_mesh_is_a_t_pose, _READ, after=("topology_is_that_of_the_bodies",)),
    Check(
        check_contact_is_more_likely_where_bodies_touch,
        _READ,
        after=_MESH,
    ),
    Check(check_vertices_are_in_order, _READ, after=(*_MESH, "contact_is_more_likely_where_bodies_touch")),
    Check(check_rows_follow_the_people, _READ, after=_MESH),
)
"""Checks of a ContactPrior, in order of execution."""
