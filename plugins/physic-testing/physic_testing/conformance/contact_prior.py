"""How outputs of a ContactPrior are compared: the mesh, and the order of the probabilities on
it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.accuracy import CONTACT_THRESHOLD
from physic_testing.conformance.changes import CHANGES
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.readings import Group, Reading, Table, Values, changed, values_of
from physic_testing.conformance.row_order import ROW_CHECKS
from physic_testing.conformance.truth import contact_on_embedded, embedded_body

if TYPE_CHECKING:
    from physic_core.types import ContactProbability, FloatArray, IntArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.changes import Change


@lru_cache(maxsize=1)
def mirrored_vertices() -> IntArray:
    """Return for each vertex of the embedded body (V,) the nearest one on the other side of the
    T-pose.
    """
    from scipy.spatial import cKDTree

    from physic_core.body.convert.bodies import rest_mesh_of_model

    vertices = rest_mesh_of_model(embedded_body()).vertices
    found: IntArray = cKDTree(vertices).query(vertices * [-1, 1, 1])[1]
    return found


def _values(answer: ContactProbability, case: Case, truth: Values) -> Values:
    return {"likely": contact_on_embedded(answer).probability.astype(np.float64)}


def _act(values: Values, change: Change, case: Case) -> Values:
    return {
        "likely": values["likely"][:, mirrored_vertices()] if change.mirrors else values["likely"]
    }


def _normal(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    """Return the probabilities of outer vertices, of mean 0 and length 1; NaN of people of whom
    nothing is likelier.
    """
    outer = embedded_body().outer.numpy()
    found = []
    for row, true in zip(values["likely"][:, outer], truth["likely"][:, outer], strict=True):
        flat = row - row.mean()
        known = min(np.ptp(row), np.ptp(true)) > 1e-6
        found.append(flat / np.linalg.norm(flat) if known else np.full(len(row), np.nan))
    return found


def _half_reversed(likely: FloatArray) -> FloatArray:
    middle = likely.shape[1] // 2
    return np.concatenate([likely[:, :middle], likely[:, middle:][:, ::-1]], axis=1)


def _claimed(likely: FloatArray, true: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return for each vertex that touches or is said to touch whether it is said to, and whether it
    does.
    """
    said = likely > CONTACT_THRESHOLD
    touching = true > 0
    either = said | touching
    return said[either].astype(np.float64), touching[either].astype(np.float64), 0.5


TABLE = Table(
    _values,
    lambda answer, case: {"likely": case.truth.contact.astype(np.float64)},
    _act,
    (
        Group(
            "vertices_are_in_order",
            "probabilities in the order of the vertices, 1 for contact",
            "of a unit vector",
            _normal,
            (
                Reading(
                    "mirrored",
                    changed(likely=lambda p: p[:, mirrored_vertices()]),
                    "Was the photo mirrored for the network?",
                ),
                Reading(
                    "inverted", changed(likely=lambda p: 1 - p), "1 is contact.", in_pairs=False
                ),
                Reading(
                    "in reverse order",
                    changed(likely=lambda p: p[:, ::-1]),
                    "Is the order of the vertices reversed?",
                ),
                Reading(
                    "half in reverse order",
                    changed(likely=_half_reversed),
                    "Is half of the vertices reversed?",
                ),
            ),
            after=("rest_mesh_is_a_t_pose",),
        ),
    ),
    "physic_core.types.ContactProbability",
    lambda values, truth: _claimed(values["likely"], truth["likely"]),
    CHANGES[:1],
    ("topology_is_that_of_the_bodies",),
)


def check_topology_is_that_of_the_bodies(subject: BackendUnderTest) -> None:
    """Without `rest`, `topology` is that of the input bodies and each vertex has one
    probability.
    """
    answer = subject.result()
    truth = subject.case("one person").truth
    if answer.rest is not None and answer.topology != truth.topology:
        return
    expect(
        answer.topology == truth.topology,
        f"the topology of the bodies, {truth.topology!r}",
        f"{answer.topology!r}",
    )
    count = answer.probability.shape[1]
    wanted = truth.vertices.shape[1]
    expect(count == wanted, f"{wanted} vertices of {truth.topology!r}", f"{count}")


def check_rest_mesh_is_a_t_pose(subject: BackendUnderTest) -> None:
    """The mesh in `rest` is a body in the T-pose, in metres, from which contact can be
    transferred.
    """
    from physic_core.errors import BodyModelError

    answer = subject.result()
    try:
        contact_on_embedded(answer)
    except BodyModelError as error:
        if answer.rest is not None:
            wanted = "a mesh in the T-pose: metres, y up, facing +z, left side on +x"
            raise CheckFailed(wanted, str(error)) from error


def check_contact_is_more_likely_where_bodies_touch(subject: BackendUnderTest) -> None:
    """Probabilities differ between vertices, and no other first vertex puts them nearer to where
    bodies touch.
    """
    outer = embedded_body().outer.numpy()
    evidence = values_of(subject, TABLE)
    people = [
        (likely, true)
        for _, v, t in evidence
        for likely, true in zip(v["likely"], t["likely"], strict=True)
        if true.any()
    ]
    low, high = (f([f(likely) for likely, _ in people] or [0.0]) for f in (np.min, np.max))
    wanted = "a higher probability where bodies touch than elsewhere"
    is_one = low == high > 0
    expect(
        not is_one,
        wanted,
        f"{low:.2f} everywhere",
        "Is it a constant: is the network's answer used?",
    )
    is_narrow = low >= 0.5 and high <= 1 / (1 + np.exp(-1.0)) + 1e-3
    expect(
        not is_narrow, wanted, f"values from {low:.2g} to {high:.2g}", "Is a sigmoid applied twice?"
    )
    people = [(likely, true) for likely, true in people if np.ptp(likely) > 1e-6]
    if len(people) < 3:
        raise CheckSkipped(f"{len(people)} people have contact and probabilities, 3 are needed")
    fits = np.mean([_circular_fit(likely, true) for likely, true in people], axis=0)
    moved = int(np.argmax(fits))
    hint = f"They fit {moved} numbers earlier: do they begin at another vertex?"
    better = [
        float(fit[moved] - fit[0])
        for fit in (_circular_fit(likely, true) for likely, true in people)
    ]
    is_sure = np.mean(better) > 3 * np.std(better) / np.sqrt(len(better)) and np.mean(better) > 0.1
    expect(
        not is_sure,
        "probabilities in the order of the vertices",
        f"{moved} vertices farther on",
        hint,
    )
    touching, others = (
        float(np.mean([p[outer & (t == c)].mean() for p, t in people])) for c in (1, 0)
    )
    expect(
        touching > others,
        "a higher mean probability where bodies touch than elsewhere",
        f"{touching:.2f} there, {others:.2f} elsewhere",
        "1 is contact, and probabilities are in the order of the vertices.",
    )


def _circular_fit(likely: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the correlation (V,) of probabilities with the truth, for each number of vertices they
    may be moved by.
    """
    spectra = [
        np.fft.rfft((values - values.mean()) / max(float(values.std()), 1e-9))
        for values in (likely, truth)
    ]
    fit: FloatArray = np.fft.irfft(spectra[0] * spectra[1].conj(), len(likely)) / len(likely)
    return fit


_READ = TABLE.read
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_topology_is_that_of_the_bodies, _READ),
    Check(check_rest_mesh_is_a_t_pose, _READ, after=("topology_is_that_of_the_bodies",)),
    Check(
        check_contact_is_more_likely_where_bodies_touch,
        _READ,
        after=("vertices_are_in_order", "rest_mesh_is_a_t_pose"),
        unless=BLIND,
    ),
    *ROW_CHECKS,
)
"""Further checks of a ContactPrior, in order of execution."""
