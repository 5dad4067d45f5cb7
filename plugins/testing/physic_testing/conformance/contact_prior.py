"""How outputs of a ContactPrior are compared: the mesh, and the order of the probabilities on
it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.interfaces.comparison import is_sigmoid_of_probability
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.output_checks import ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.readings import (
    MIN_UNITS,
    Group,
    Reading,
    Table,
    flipped,
    values_of,
)
from physic_testing.conformance.truth import contact_on_embedded, embedded_body

if TYPE_CHECKING:
    from physic_core.types import ContactProbability, FloatArray, IntArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values


def _values(answer: ContactProbability, case: Case) -> tuple[Values, Truth]:
    likely = contact_on_embedded(answer).probability.astype(float)
    return {"likely": likely}, {"likely": case.truth.contact.astype(float)}


def _normalised(likely: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the probabilities of outer vertices, of mean 0 and length 1; NaN of people of whom
    nothing is likelier.
    """
    outer = embedded_body().outer.numpy()
    found = []
    for row, true in zip(likely[:, outer], truth["likely"][:, outer], strict=True):
        flat = row - row.mean()
        known = min(np.ptp(row), np.ptp(true)) > 1e-6
        found.append(flat / np.linalg.norm(flat) if known else np.full(len(row), np.nan))
    return found


@lru_cache(maxsize=1)
def _mirrored_vertices() -> IntArray:
    """Return for each vertex of the embedded body (V,) the nearest one on the other side of the
    T-pose.
    """
    from scipy.spatial import cKDTree

    from physic_core.body import rest_mesh_of_model

    vertices = rest_mesh_of_model(embedded_body()).vertices
    found: IntArray = cKDTree(vertices).query(vertices * [-1, 1, 1])[1]
    return found


def _half_reversed(likely: FloatArray, truth: Truth) -> FloatArray:
    first, second = np.split(likely, [likely.shape[1] // 2], axis=1)
    return np.concatenate([first, second[:, ::-1]], axis=1)


def check_mesh_is_known(subject: BackendUnderTest) -> None:
    """The probabilities are those of the bodies' mesh, or of a mesh whose T-pose is in `rest`."""
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
    people = [
        (likely, true)
        for values, truth in values_of(subject, _values)
        for likely, true in zip(values["likely"], truth["likely"], strict=True)
        if true.any()
    ]
    every = np.concatenate([likely for likely, _ in people] or [np.zeros(1)])
    low = every.min()
    high = every.max()
    wanted = "a higher probability where bodies touch than elsewhere"
    hint = "Is it a constant: is the network's answer used?"
    expect(not low == high > 0, wanted, f"{low:.2f} everywhere", hint)
    got = f"values from {low:.2g} to {high:.2g}"
    expect(not is_sigmoid_of_probability(every), wanted, got, "Is a sigmoid applied twice?")
    people = [(likely, true) for likely, true in people if np.ptp(likely) > 1e-6]
    if len(people) < MIN_UNITS:
        raise CheckSkipped(
            f"{len(people)} people have contact and probabilities, {MIN_UNITS} are needed"
        )
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


_FLIP = "Was the photo mirrored for the network?"
_REVERSED = "Is the order of the vertices reversed?"
_HALF = "Is half of the vertices reversed?"

TABLE = Table(
    _values,
    (
        WITHOUT_PEOPLE,
        Check(check_mesh_is_known),
        Check(
            check_contact_is_more_likely_where_bodies_touch,
            after=("vertices_are_in_order", "mesh_is_known"),
            unless=BLIND,
        ),
        *ROWS,
    ),
    (
        Group(
            "vertices_are_in_order",
            "probabilities in the order of the vertices, 1 for contact",
            "likely",
            "of a unit vector",
            (
                Reading("mirrored", lambda p, _: p[:, _mirrored_vertices()], _FLIP),
                Reading("inverted", lambda p, _: 1 - p, "1 is contact."),
                Reading("in reverse order", flipped(1), _REVERSED),
                Reading("half in reverse order", _half_reversed, _HALF),
            ),
            _normalised,
        ),
    ),
    after=("mesh_is_known",),
)
