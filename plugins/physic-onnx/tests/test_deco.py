"""DECO: BGR on white, probabilities on the mesh that comes with it, and the kit on stand-ins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core.body import load_body
from physic_core.body.parameters import parameters_from_rotations
from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior
from physic_core.types import Bodies, ContactProbability, People
from physic_onnx.deco import Deco
from physic_testing import violations
from physic_testing.conformance import check_backend

from .pose_worlds import whose

MODEL = load_body("embedded")


def bodies(count: int) -> Bodies:
    rotations, betas, transl = MODEL.zero_pose(count)
    return Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded")


def people(*boxes: tuple[float, float, float, float], size: tuple[int, int] = (240, 320)) -> People:
    return People(np.zeros((len(boxes), *size), bool), np.array(boxes, float).reshape(-1, 4), np.ones(len(boxes)))


@pytest.fixture
def deco(tmp_path: Path, graph: Any, node: Any) -> Any:
    """A file whose three vertices are the three channels of the middle and of the left edge, brought back to [0, 1]."""

    def make(scale: float = 1.0, batch: int | str = "batch", **options: Any) -> Deco:
        path = graph(
            tmp_path / "model.onnx",
            {"image": ("float32", (batch, 3, 256, 256))},
            {
                "contact": ("float32", (batch, 6)),
                "faces": ("int64", (2, 3)),
                "rest": ("float32", (6, 3)),
            },
            [
                node("Mul", ["image", "std"], ["grown"]),
                node("Add", ["grown", "mean"], ["grey"]),
                node("Gather", ["grey", "row"], ["line"], axis=2),
                node("Gather", ["line", "columns"], ["values"], axis=2),
                node("Flatten", ["values"], ["flat"]),
                node("Mul", ["flat", "scale"], ["contact"]),
                node("Identity", ["held faces"], ["faces"]),
                node("Identity", ["held rest"], ["rest"]),
            ],
            {
                "std": np.array([0.229, 0.224, 0.225], np.float32).reshape(1, 3, 1, 1),
                "mean": np.array([0.485, 0.456, 0.406], np.float32).reshape(1, 3, 1, 1),
                "row": np.array(128),
                "columns": np.array([128, 2]),
                "scale": np.array(scale, np.float32),
                "held faces": np.array([[0, 1, 2], [3, 4, 5]]),
                "held rest": np.arange(18, dtype=np.float32).reshape(6, 3),
            },
        )
        backend = Deco(Deco.Options(weights=str(path), **options))
        backend.load()
        return backend

    return make


def coloured() -> np.ndarray:
    photo = np.zeros((240, 320, 3), np.uint8)
    photo[...] = (200, 100, 50)
    return photo


def test_it_is_shown_bgr_letterboxed_on_white(deco: Any) -> None:
    found = deco().infer(coloured(), people((100, 20, 140, 220)), bodies(1))
    assert violations(ContactPrior, found, people=1, vertices=MODEL.num_vertices, topology=MODEL.topology) == []
    middle, edge = found.probability.reshape(3, 2).T
    assert np.allclose(middle, np.array([50, 100, 200]) / 255, atol=1e-3)  # blue, green, red
    assert np.allclose(edge, 1.0, atol=1e-3)  # white beside a narrow box


def test_squashing_leaves_no_white(deco: Any) -> None:
    found = deco(fit="squash").infer(coloured(), people((100, 20, 140, 220)), bodies(1))
    assert np.allclose(found.probability.reshape(3, 2)[:, 1], np.array([50, 100, 200]) / 255, atol=1e-3)


@pytest.mark.parametrize("batch", [1, "batch"])
def test_the_mesh_is_returned_with_and_without_people(deco: Any, batch: int | str) -> None:
    backend = deco(batch=batch)
    for count in (0, 1, 3):
        found = backend.infer(coloured(), people(*[(100, 20, 140, 220)] * count), bodies(count))
        assert found.probability.shape == (count, 6)
        assert found.topology == "smpl"
        assert found.rest is not None
        assert found.rest.vertices.tolist() == np.arange(18).reshape(6, 3).tolist()
        assert found.rest.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_logits_are_refused(deco: Any) -> None:
    with pytest.raises(BackendError, match="export the network with its sigmoid"):
        deco(scale=-5.0).infer(coloured(), people((100, 20, 140, 220)), bodies(1))


def stand_in_deco(stand_in: Any, stand_in_network: Any) -> type:
    """The adapter over a network that knows which vertices touch; the embedded body stands for SMPL."""
    rest = MODEL(*MODEL.zero_pose()).vertices[0].numpy()
    faces = MODEL.faces.numpy()

    def attach(backend: Any) -> list[Any]:
        def answer(shown: Any, feed: Any) -> dict[str, np.ndarray]:
            held = {"faces": faces, "rest": rest}
            if backend.held:  # asked for the mesh alone
                backend.held = False
                return held
            boxes = backend.next_boxes(len(feed["image"]))
            contact = np.full((len(boxes), len(rest)), 0.1)
            for i, box in enumerate(boxes):
                row = None if shown.world is None else whose(shown.world, box)
                if row is not None:
                    contact[i] = np.where(shown.world.contact[row], 0.9, 0.05)
            return {"contact": contact, **held}

        network = stand_in_network(
            {"image": ("float32", ("b", 3, 256, 256))},
            {
                "contact": ("float32", ("b", len(rest))),
                "faces": ("int64", faces.shape),
                "rest": ("float32", rest.shape),
            },
            answer,
        )
        backend.bind(network)
        return [network]

    class StandIn(stand_in(Deco, attach)):  # type: ignore[misc]
        def infer(self, image: np.ndarray, people: People, bodies: Bodies) -> ContactProbability:
            self.held = True
            return super().infer(image, people, bodies)

    return StandIn


def test_conformance(stand_in: Any, stand_in_network: Any) -> None:
    report = check_backend(stand_in_deco(stand_in, stand_in_network), "contact_prior")
    print(report.summary, report.accuracy)
    report.raise_if_failed()
