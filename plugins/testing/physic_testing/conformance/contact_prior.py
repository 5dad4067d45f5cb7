"""How outputs of a ContactPrior are compared: the mesh, and the order of the probabilities on
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BodyModelError
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, expect
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    flipped,
    normalised,
)
from physic_testing.conformance.output_checks import ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.truth import contact_on_embedded, embedded_body
from physic_testing.metrics import contact_scores

if TYPE_CHECKING:
    from physic_core.types import ContactProbability, FloatArray, IntArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

OWN_BODY_M = 0.02
"""Distance of two parts of a body that touch, which are farther apart than APART_M at rest."""

APART_M = 0.15

CONTACT_THRESHOLD = 0.5
"""Probability above which a vertex counts as in contact."""


def _values(answer: ContactProbability, case: Case) -> tuple[Values, Truth]:
    likely = contact_on_embedded(answer).probability.astype(float)
    return {"likely": likely}, {"likely": case.truth.contact.astype(float)}


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    scores = contact_scores(values["likely"] > CONTACT_THRESHOLD, truth["case"].truth.contact)
    return {"F1": scores.f1_mean}


def _order(likely: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the rows on the outer skin with mean 0 and length 1."""
    return normalised(likely[:, embedded_body().outer.numpy()], truth)


@lru_cache(maxsize=1)
def _rest() -> FloatArray:
    """Return the vertices (V, 3) of the embedded body in the T-pose."""
    from physic_core.body import rest_mesh_of_model

    return rest_mesh_of_model(embedded_body()).vertices


@lru_cache(maxsize=1)
def _mirrored_vertices() -> IntArray:
    """Return for each vertex of the embedded body (V,) the nearest one on the other side of the
    T-pose.
    """
    from scipy.spatial import cKDTree

    rows: IntArray = cKDTree(_rest()).query(_rest() * [-1, 1, 1])[1]
    return rows


def _half_reversed(likely: FloatArray, truth: Truth) -> FloatArray:
    first, second = np.split(likely, [likely.shape[1] // 2], axis=1)
    return np.concatenate([first, second[:, ::-1]], axis=1)


def _with_own_body(likely: FloatArray, truth: Truth) -> FloatArray:
    """Return contact with that of the person's own body."""
    from scipy.spatial import cKDTree

    scores = likely.copy()
    for row, vertices in zip(scores, truth["case"].truth.vertices, strict=True):
        pairs = cKDTree(vertices).query_pairs(OWN_BODY_M, output_type="ndarray")
        apart = np.linalg.norm(_rest()[pairs[:, 0]] - _rest()[pairs[:, 1]], axis=1) > APART_M
        row[pairs[apart]] = 1
    return scores


def _rotated(key: str, evidence: Sequence[tuple[Values, Truth]]) -> list[KnownMistake]:
    """Return as a reading the number of vertices by which probabilities fit the truth better."""
    fits = [
        np.fft.irfft(
            np.fft.rfft(answered - answered.mean()) * np.fft.rfft(true - true.mean()).conj()
        )
        for values, truth in evidence
        for answered, true in zip(values[key], truth[key], strict=True)
    ]
    moved = int(np.sum(fits, axis=0).argmax())
    hint = f"They fit {moved} numbers earlier: do they begin at another vertex?"
    reading = KnownMistake(
        f"{moved} vertices farther on", lambda p, _: np.roll(p, moved, 1), hint, limit=0.3
    )
    return [reading] if moved else []


def check_mesh_is_known(subject: BackendUnderTest) -> None:
    """The probabilities are those of the bodies' mesh, or of a mesh whose T-pose is in `rest`."""
    answer = subject.result()
    truth = subject.case("one person").truth
    mesh = answer.topology, answer.probability.shape[1]
    expect(
        answer.rest is not None or mesh == (truth.topology, truth.vertices.shape[1]),
        f"{truth.vertices.shape[1]} vertices of the bodies' topology {truth.topology!r}, or `rest`",
        "{1} of {0!r}".format(*mesh),
    )
    try:
        contact_on_embedded(answer)
    except BodyModelError as error:
        wanted = "a mesh in the T-pose: meters, y up, facing +z, left side on +x"
        raise CheckFailed(wanted, str(error)) from error


_FLIP = "Was the photo mirrored for the network?"

TABLE = Table(
    _values,
    _errors,
    (WITHOUT_PEOPLE, Check(check_mesh_is_known), *ROWS),
    (
        Group(
            "vertices_are_in_order",
            "probabilities in the order of the vertices, 1 for contact with the scene",
            "likely",
            "of a unit vector",
            (
                KnownMistake("mirrored", lambda p, _: p[:, _mirrored_vertices()], _FLIP),
                KnownMistake("inverted", lambda p, _: 1 - p, "1 is contact."),
                KnownMistake(
                    "in reverse order", flipped(1), "Is the order of the vertices reversed?"
                ),
                KnownMistake("half in reverse order", _half_reversed, "Is half of them reversed?"),
                KnownMistake(
                    "with the own body's", _with_own_body, "Contact is with the scene alone."
                ),
            ),
            _order,
            search=_rotated,
            is_telling=True,
        ),
    ),
    after=("mesh_is_known",),
)
