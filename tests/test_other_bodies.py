"""Bodies of other models, hands with wrists, contact on other meshes: at the border, in the cache, in the pipeline."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physic_core import border, salvage
from physic_core.cache.answers import settled
from physic_core.cache.archive import pack, unpack
from physic_core.cache.npz import read, write
from physic_core.types import Bodies, BodyParameters, ContactProbability, Hands, Mesh, RestMesh

FACES = np.array([[0, 1, 2], [1, 2, 3]], np.int32)
CLASSES = (Bodies, BodyParameters, ContactProbability, Hands, Mesh, RestMesh)


def parameters(people: int = 2) -> BodyParameters:
    def zeros(width: int) -> np.ndarray:
        return np.zeros((people, width), np.float32)

    return BodyParameters(
        zeros(3), zeros(63), zeros(45), zeros(45), zeros(3), zeros(3), zeros(3), zeros(10), zeros(0), zeros(3)
    )


def bodies(people: int = 2) -> Bodies:
    joints = np.zeros((people, 55, 3), np.float32)
    joints[:, 22:] = np.nan
    mesh = Mesh("mhr", np.zeros((people, 4, 3), np.float32), FACES, np.zeros((4, 3), np.float32))
    return Bodies(parameters(people), "mhr", None, joints, mesh)


def hands() -> Hands:
    return Hands(np.zeros((2, 2, 15, 3)), np.array([[0.5, 0.0], [0.9, 0.9]]), np.zeros((2, 2, 3)))


def contact() -> ContactProbability:
    return ContactProbability(np.zeros((2, 4)), "smpl", RestMesh("smpl", np.zeros((4, 3)), FACES))


def test_right_answers_have_no_faults() -> None:
    assert border.bodies_faults(bodies(), 2) == []
    assert border.bodies_faults(bodies(0), 0) == []
    assert border.hands_faults(hands(), 2) == []
    assert border.contact_faults(contact(), 2, 9, "physic-embedded-1") == []


def test_faces_may_be_integers_of_any_width() -> None:
    for kind in (np.int32, np.int64, np.uint32):
        told = bodies()
        assert told.mesh is not None
        assert border.bodies_faults(replace(told, mesh=replace(told.mesh, faces=FACES.astype(kind))), 2) == []


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"joints": np.zeros((2, 24, 3))}, "joints must be (2, 55, 3), got (2, 24, 3)"),
        ({"joints": np.zeros((2, 55, 3), int)}, "joints must be float, got int64"),
        (
            {"joints": np.full((2, 55, 3), np.inf)},
            "joints must be metres, or NaN where nothing is known, 330 are infinite",
        ),
        ({"mesh": np.zeros((2, 4, 3))}, "mesh must be Mesh, got ndarray"),
        ({"mesh": Mesh("mhr", np.zeros((1, 4, 3)), FACES)}, "mesh.vertices must be (2, 4, 3), got (1, 4, 3)"),
        ({"mesh": Mesh(7, np.zeros((2, 4, 3)), FACES)}, "mesh.name must be str, got int"),  # type: ignore[arg-type]
        (
            {"mesh": Mesh("mhr", np.zeros((2, 4, 3)), FACES + 1)},
            "mesh.faces must number the 4 vertices from 0, got 1 to 4",
        ),
        (
            {"mesh": Mesh("mhr", np.zeros((2, 4, 3)), FACES.astype(float))},  # type: ignore[arg-type]
            "mesh.faces must be integers, got float64",
        ),
        ({"mesh": Mesh("mhr", np.zeros((2, 4, 3)), FACES[0])}, "mesh.faces must be (3, 3), got (3)"),
        (
            {"mesh": Mesh("mhr", np.full((2, 4, 3), np.nan), FACES)},
            "mesh.vertices must be finite, 24 values are not",
        ),
        (
            {"mesh": Mesh("mhr", np.zeros((2, 4, 3)), FACES, np.zeros((5, 3)))},
            "mesh.rest must be (4, 3), got (5, 3)",
        ),
    ],
)
def test_faults_of_bodies(change: dict[str, object], fault: str) -> None:
    assert border.bodies_faults(replace(bodies(), **change), 2) == [fault]  # type: ignore[arg-type]


def test_faults_of_wrists() -> None:
    assert border.hands_faults(replace(hands(), wrists=np.zeros((2, 2, 3, 3))), 2) == [
        "wrists must be (2, 2, 3), got (2, 2, 3, 3)"
    ]
    assert border.hands_faults(replace(hands(), wrists=np.full((2, 2, 3), np.nan)), 2) == [
        "wrists must be finite, 9 values are not"
    ]


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"rest": None}, "topology must be 'embedded' as the bodies', got 'smpl'"),
        ({"rest": FACES}, "rest must be RestMesh, got ndarray"),
        ({"probability": np.zeros((2, 5))}, "probability must be (2, 4), got (2, 5)"),
        (
            {"rest": RestMesh("smplx", np.zeros((4, 3)), FACES)},
            "rest must be the mesh 'smpl' that the probabilities are on, got 'smplx'",
        ),
        (
            {"rest": RestMesh("smpl", np.full((4, 3), np.nan), FACES)},
            "rest.vertices must be finite, 12 values are not",
        ),
        (
            {"rest": RestMesh("smpl", np.zeros((4, 3)), FACES + 2)},
            "rest.faces must number the 4 vertices from 0, got 2 to 5",
        ),
    ],
)
def test_faults_of_contact_on_another_mesh(change: dict[str, object], fault: str) -> None:
    assert border.contact_faults(replace(contact(), **change), 2, 9, "embedded") == [fault]  # type: ignore[arg-type]


def test_a_body_whose_mesh_is_nan_is_lost_with_all_that_is_its_own() -> None:
    told = bodies()
    assert told.mesh is not None
    told.mesh.vertices[0, 2] = np.nan
    assert border.bodies_faults(told, 2) == []
    kept, lost = salvage.bodies_or_nan(told)
    assert lost.tolist() == [True, False]
    assert kept.mesh is not None
    assert kept.joints is not None
    for value in (kept.parameters.transl, kept.joints, kept.mesh.vertices):
        assert np.isnan(value[0]).all()
    np.testing.assert_array_equal(kept.joints[1], bodies().joints[1])  # type: ignore[index]
    assert np.isfinite(kept.mesh.vertices[1]).all()
    np.testing.assert_array_equal(kept.mesh.faces, FACES)


def test_hands_whose_wrists_are_nan_are_not_found() -> None:
    wrists = np.zeros((2, 2, 3))
    wrists[0, 1] = np.nan  # of a hand that was not found: means nothing
    assert not salvage.found_hands(replace(hands(), wrists=wrists))[1].any()
    wrists[0, 0] = np.nan
    kept, lost = salvage.found_hands(replace(hands(), wrists=wrists))
    assert lost.tolist() == [True, False]
    assert kept.confidence[0].tolist() == [0, 0]
    assert kept.wrists is not None
    assert np.isfinite(kept.wrists).all()


def test_some_of_the_bodies_share_their_faces() -> None:
    some = salvage.rows_of(bodies(), np.array([False, True]))
    assert some.joints is not None
    assert some.mesh is not None
    assert some.mesh.rest is not None
    assert (len(some.joints), some.mesh.vertices.shape, some.mesh.rest.shape) == (1, (1, 4, 3), (4, 3))
    np.testing.assert_array_equal(some.mesh.faces, FACES)


@pytest.mark.parametrize("answer", [bodies(), hands(), contact()], ids=lambda answer: type(answer).__name__)
def test_answers_with_the_new_fields_are_kept(answer: Bodies | Hands | ContactProbability, tmp_path: Path) -> None:
    arrays, document = pack(answer)
    write(tmp_path, "one.npz", arrays, document)
    found = unpack(*read(tmp_path / "one.npz"), CLASSES)
    told, again = (dict(pack(a)[0]) for a in (answer, found))
    assert list(told) == list(again)
    for path, array in told.items():
        np.testing.assert_array_equal(again[path], array)
        assert again[path].dtype == array.dtype
    assert type(settled(answer)) is type(answer)


def test_answers_that_were_kept_before_these_fields_are_read() -> None:
    """A field that an old document does not name is None, which is what it was."""
    for answer, fields in (
        (Bodies(parameters(), "embedded"), ("joints", "mesh")),
        (Hands(hands().rotvecs, hands().confidence), ("wrists",)),
        (ContactProbability(contact().probability, "smpl"), ("rest",)),
    ):
        arrays, document = pack(answer)
        for field in fields:
            del document["fields"][field]
        found = unpack(arrays, document, CLASSES)
        assert [getattr(found, field) for field in fields] == [None] * len(fields)
