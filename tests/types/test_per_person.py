"""Rows of people in results of backends: some are selected, and others added."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import (
    Bodies,
    BodyParameters,
    ContactProbability,
    Hands,
    Keypoints,
    Mesh,
    Observations,
    People,
)
from physic_core.types.arrays import expand_people, select_people, wrong_rows

N = 3
LAST_TWO = np.array([False, True, True])


def rows(*shape):
    """Array whose row i is full of i."""
    return np.broadcast_to(np.arange(float(N)).reshape(N, *[1] * len(shape)), (N, *shape)).copy()


def keypoints():
    return Keypoints(
        rows(17, 2), rows(17), "coco17", rows(17, 3), rows(17), rows(17), world_spread=rows(17)
    )


def results():
    """Results of backends whose arrays all have N rows, row i full of i."""
    parameters = BodyParameters(*(rows(size) for size in (3, 63, 45, 45, 3, 3, 3, 10, 10, 3)))
    mesh = Mesh("smpl", rows(4, 3), faces=np.zeros((N, 3), int), rest=np.zeros((N, 3)))
    return (
        People(rows(2, 4), rows(4), rows(), keypoints=keypoints(), heads=rows()),
        keypoints(),
        Bodies(parameters, "smplx", rows(55), rows(55, 3), mesh, rows(22), rows(), rows(55)),
        Hands(rows(2, 15, 3), rows(2), rows(2, 3)),
        Observations(rows(9), rows(10, 5), rows(2), rows(), rows(), rows(3), rows(), *[None] * 3),
        ContactProbability(rows(4), "smpl"),
    )


@pytest.mark.parametrize("result", results(), ids=lambda result: type(result).__name__)
def test_all_that_is_per_person_is_selected_expanded_and_counted(result):
    some = select_people(result, LAST_TWO)
    for array in arrays(some, but=("faces", "rest")):
        assert np.unique(array).tolist() == [1.0, 2.0]
    assert len(list(wrong_rows(some, N))) == sum(1 for _ in arrays(some, but=("faces", "rest")))
    for array in arrays(expand_people(some, LAST_TWO), but=("faces", "rest")):
        assert [np.unique(row).tolist() for row in array] == [[0.0], [1.0], [2.0]]


def test_a_field_with_another_number_of_people_is_named():
    people = People(rows(2, 4), rows(4), rows(), keypoints=keypoints(), heads=np.zeros(2, int))
    assert list(wrong_rows(people, N)) == ["heads has 2 rows"]
    fewer = People(rows(2, 4), rows(4), rows(), keypoints=select_people(keypoints(), LAST_TWO))
    assert next(wrong_rows(fewer, N)) == "keypoints.points has 2 rows"


def arrays(result, but):
    for name, value in vars(result).items():
        if isinstance(value, np.ndarray):
            if name not in but:
                yield value
        elif hasattr(value, "__dataclass_fields__") and name != "skeleton":
            yield from arrays(value, but)


def test_what_people_share_stays_although_it_has_as_many_rows():
    shared = {name: np.zeros((N, N), bool) for name in ("floor", "unposed_mask")}
    some = select_people(People(np.ones((N, N, N), bool), rows(4), rows(), **shared), LAST_TWO)
    assert all(getattr(some, name) is value for name, value in shared.items())
    mesh = select_people(
        Mesh("smpl", rows(4, 3), np.zeros((N, 3), int), np.zeros((N, 3))), LAST_TWO
    )
    assert len(mesh.vertices) == 2
    assert len(mesh.faces) == len(mesh.rest) == N
