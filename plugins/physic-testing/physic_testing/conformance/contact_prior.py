"""How outputs of a ContactPrior are compared: the mesh, and the order of the probabilities on
it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS, ROW_CHECKS
from physic_testing.conformance.readings import Group, Reading, Table, Values, changed, values_of
from physic_testing.conformance.truth import contact_on_embedded, embedded_body

if TYPE_CHECKING:
    from physic_core.types import ContactProbability, FloatArray, IntArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case


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


TABLE = Table(
    _values,
    lambda answer, case: {"likely": case.truth.contact.astype(np.float64)},
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
                Reading("inverted", changed(likely=lambda p: 1 - p), "1 is contact."),
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
        ),
    ),
    "physic_core.types.ContactProbability",
    ("mesh_is_known",),
)


def check_mesh_is_known(subject: BackendUnderTest) -> None:
    """The probabilities are those of the bodies' mesh, or of a mesh whose T-pose is in `rest`."""
    from physic_core.errors import BodyModelError

    answer = subject.result()
    truth = subject.case("one person").truth
    if answer.rest is not None and answer.topology != truth.topology:
        try:
            contact_on_embedded(answer)
        except BodyModelError as error:
            wanted = "a mesh in the T-pose: metres, y up, facing +z, left side on +x"
            raise CheckFailed(wanted, str(error)) from error
        return
    expect(
        (answer.topology, answer.probability.shape[1]) == (truth.topology, truth.vertices.shape[1]),
        f"{truth.vertices.shape[1]} vertices of the bodies' topology {truth.topology!r}",
        f"{answer.probability.shape[1]} of {answer.topology!r}",
    )


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
    low = min((float(likely.min()) for likely, _ in people), default=0.0)
    high = max((float(likely.max()) for likely, _ in people), default=0.0)
    wanted = "a higher probability where bodies touch than elsewhere"
    hint = "Is it a constant: is the network's answer used?"
    expect(not low == high > 0, wanted, f"{low:.2f} everywhere", hint)
    is_narrow = low >= 0.5 and high <= 1 / (1 + np.exp(-1.0)) + 1e-3
    expect(
        not is_narrow, wanted, f"values from {low:.2g} to {high:.2g}", "Is a sigmoid applied twice?"
    )
    people = [(likely, true) for likely, true in people if np.ptp(likely) > 1e-6]
    if len(people) < 3:
        raise CheckSkipped(f"{len(people)} people have contact and probabilities, 3 are needed")
    fits = np.array([_circular_fit(likely, true) for likely, true in people])
    moved = int(np.argmax(fits.mean(axis=0)))
    better = fits[:, moved] - fits[:, 0]
    is_sure = better.mean() > max(3 * better.std() / np.sqrt(len(better)), 0.1)
    expect(
        not is_sure,
        "probabilities in the order of the vertices",
        f"{moved} vertices farther on",
        f"They fit {moved} numbers earlier: do they begin at another vertex?",
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
    Check(check_mesh_is_known, _READ),
    Check(
        check_contact_is_more_likely_where_bodies_touch,
        _READ,
        after=("vertices_are_in_order", "mesh_is_known"),
        unless=BLIND,
    ),
    *ROW_CHECKS,
)
"""Further checks of a ContactPrior, in order of execution."""
