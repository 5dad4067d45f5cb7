"""DECO and InteractVLM's results: crops, colours, files, thresholds, and the whole kit with a perfect network."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from physic_core.adapters.devices import check_device
from physic_core.adapters.smpl import empty_bodies, parameters_from_rotvecs
from physic_core.errors import BackendError, WeightsMissingError
from physic_core.types import Bodies, ContactProbability, People
from physic_human.deco import Deco, DecoOptions
from physic_human.interactvlm import InteractVlmOptions, InteractVlmResults
from physic_human.user_smpl import load_rest_mesh
from physic_testing.conformance import parametrize_with_checks
from physic_testing.worlds import World, world_of

from .seen import CropsOnWorlds, coordinates, network_of, normalised_back, place_of, smpl_contact

NOBODY = empty_bodies("embedded")

DECO = """
import torch
from utils.hrnet import WIDTH

class DECO(torch.nn.Module):
    def __init__(self, encoder, context, device):
        super().__init__()
        assert (encoder, context, str(device)) == ("hrnet", True, "cpu") and WIDTH == 32
        self.gain = torch.nn.Parameter(torch.zeros(1))
        self.seen = []

    def forward(self, img):
        self.seen.append(img.numpy().copy())
        contact = torch.zeros(len(img), 6890)
        contact[:, 0] = 0.75 * self.gain
        return contact, torch.zeros(len(img), 133, 64, 64), torch.zeros(len(img), 26, 64, 64)
"""
OLD_DECO = DECO.replace("encoder, context, device)", "encoder, device)").replace(
    '(encoder, context, str(device)) == ("hrnet", True, "cpu")', '(encoder, str(device)) == ("hrnet", "cpu")'
)


def people(boxes: list[list[float]]) -> People:
    return People(np.zeros((len(boxes), 200, 300), bool), np.array(boxes, float).reshape(-1, 4), np.ones(len(boxes)))


@pytest.fixture
def deco(stub: Callable[..., Path], tmp_path: Path, smpl_file: Path) -> Callable[..., Deco]:
    def make(text: str = DECO, **options: Any) -> Deco:
        checkout = stub("deco", {"models/deco.py": text, "utils/hrnet.py": "WIDTH = 32"})
        torch.save({"deco": {"gain": torch.ones(1)}, "epoch": 3}, tmp_path / "deco_best.pth")
        weights = str(tmp_path / "deco_best.pth")
        given = {"checkout": str(checkout), "weights": weights, "smpl_file": str(smpl_file)} | options
        backend = Deco(DecoOptions(**given))
        backend.load()
        return backend

    return make


def test_deco_sees_blue_first(deco: Callable[..., Deco]) -> None:
    backend = deco()
    image = np.zeros((200, 300, 3), np.uint8)
    image[:] = [200, 100, 10]
    backend.infer(image, people([[100, 40, 180, 160]]), NOBODY)
    crop = normalised_back(network_of(backend).seen[0][0])
    np.testing.assert_allclose(crop[128, 128], [10, 100, 200], atol=0.6)
    np.testing.assert_allclose(crop[128, 5], 255, atol=0.6)  # letterboxed on white


def test_deco_sees_the_box_and_a_tenth_more(deco: Callable[..., Deco]) -> None:
    backend = deco()
    backend.infer(coordinates(200, 300), people([[100, 40, 180, 140]]), NOBODY)
    crop = normalised_back(network_of(backend).seen[0][0])[..., ::-1]
    columns = np.flatnonzero(np.abs(crop[128] - 255).max(axis=1) > 40)
    place = place_of(np.where(crop > 250, 0, crop)[:, columns[0] + 2 : columns[-1] - 1], 200, 300)
    np.testing.assert_allclose(place.step[1] * 256, 120, rtol=0.02)
    np.testing.assert_allclose(place.origin[1], 30, atol=1.5)


def test_deco_gives_smpls_labels_with_smpls_t_pose(deco: Callable[..., Deco], smpl_file: Path) -> None:
    found = deco().infer(np.zeros((200, 300, 3), np.uint8), people([[100, 40, 180, 140]] * 3), NOBODY)
    assert found.topology == "smpl"
    assert found.probability.shape == (3, 6890)
    np.testing.assert_allclose(found.probability[:, 0], 0.75)
    assert found.rest is not None
    wanted = load_rest_mesh(str(smpl_file))
    assert wanted is not None
    np.testing.assert_array_equal(found.rest.vertices, wanted.vertices)


def test_older_decos_are_built_as_they_want(deco: Callable[..., Deco]) -> None:
    found = deco(OLD_DECO).infer(np.zeros((200, 300, 3), np.uint8), people([[100, 40, 180, 140]]), NOBODY)
    np.testing.assert_allclose(found.probability[0, 0], 0.75)


def test_deco_is_called_in_batches_and_never_without_people(deco: Callable[..., Deco]) -> None:
    backend = deco(batch=2)
    backend.infer(np.zeros((200, 300, 3), np.uint8), people([[100, 40, 180, 140]] * 3), NOBODY)
    assert [len(seen) for seen in network_of(backend).seen] == [2, 1]
    found = backend.infer(np.zeros((200, 300, 3), np.uint8), people([]), NOBODY)
    assert found.probability.shape == (0, 6890)


def test_a_missing_body_model_is_named() -> None:
    assert any("the SMPL model is not given" in line for line in Deco().missing())


class PerfectDeco:
    """Knows which vertices of the person in a crop touch."""

    def __init__(self) -> None:
        self.world: World | None = None
        self.size = (1, 1)

    def __call__(self, crops: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return torch.from_numpy(np.stack([self.one(crop) for crop in crops.numpy()])), torch.zeros(1), torch.zeros(1)

    def one(self, crop: np.ndarray) -> np.ndarray:
        if self.world is None:
            return np.full(6890, 0.1, np.float32)
        shown = normalised_back(crop)[..., ::-1]
        white = (shown > 248).all(axis=2)
        place = place_of(np.where(white[..., None], 0, shown), *self.size)
        rows, columns = np.nonzero(~white)
        middle = place.origin + place.step * [columns.mean(), rows.mean()]
        boxes = self.world.boxes
        row = int(np.linalg.norm((boxes[:, :2] + boxes[:, 2:]) / 2 - middle, axis=1).argmin())
        return np.where(smpl_contact(self.world)[row], 0.9, 0.05).astype(np.float32)


class DecoOnWorlds(CropsOnWorlds, Deco):
    perfect_network = PerfectDeco

    def _build(self, device: str) -> None:
        self._rest = load_rest_mesh(self.options.smpl_file)
        super()._build(device)


OPTIONS: dict[str, str] = {}
"""Filled by the fixture of the made-up file."""


@parametrize_with_checks("contact_prior", DecoOnWorlds, options=lambda world: OPTIONS)
def test_deco_conforms(check: Callable[[], None], smpl_file: Path) -> None:
    OPTIONS["smpl_file"] = str(smpl_file)
    check()


def photo(seed: int, height: int = 200, width: int = 300) -> np.ndarray:
    """Something that looks like a photo: smooth, and unlike others."""
    small = np.random.default_rng(seed).integers(0, 255, (6, 9, 3)).astype(np.uint8)
    return np.ascontiguousarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC))


def result(folder: Path, name: str, image: np.ndarray, smpl: np.ndarray, smplx: np.ndarray | None = None) -> Path:
    """As run_demo.py leaves it."""
    folder.mkdir(exist_ok=True, parents=True)
    cv2.imwrite(str(folder / f"{name}.jpg"), image[..., ::-1])
    more = {} if smplx is None else {"pred_contact_3d_smplx": smplx}
    path = folder / f"{name}_hcontact_vertices.npz"
    np.savez(path, pred_contact_3d_smplh=smpl, **more)
    return path


def opened(results: Path, **options: Any) -> InteractVlmResults:
    backend = InteractVlmResults(InteractVlmOptions(results=str(results), **options))
    backend.load()
    return backend


def test_a_photo_finds_its_own_result_whatever_its_size(tmp_path: Path) -> None:
    for seed in (1, 2, 3):
        values = np.full((1, 6890), 0.1 * seed, np.float32)
        result(tmp_path / f"p{seed}", f"chair__p{seed}", photo(seed, 400, 600), values)
    found = opened(tmp_path, threshold=0.5).infer(photo(2), people([[0, 0, 10, 10]]), NOBODY)
    np.testing.assert_allclose(found.probability, 0.2, rtol=1e-5)
    assert found.topology == "smpl"


def test_a_photo_without_a_result_is_said_or_gives_nothing(tmp_path: Path) -> None:
    result(tmp_path, "chair__a", photo(1), np.ones((1, 6890)))
    with pytest.raises(BackendError, match=r"none of 1 results in .* belongs to this photo of 300 x 200 px"):
        opened(tmp_path).infer(photo(2), people([[0, 0, 10, 10]]), NOBODY)
    with pytest.raises(BackendError, match="none of 1 results"):
        opened(tmp_path).infer(photo(1)[:, :150], people([[0, 0, 10, 10]]), NOBODY)
    found = opened(tmp_path, when_absent="nothing").infer(photo(2), people([[0, 0, 10, 10]]), NOBODY)
    assert not found.probability.any()


def test_its_threshold_becomes_one_half(tmp_path: Path) -> None:
    values = np.zeros((1, 6890), np.float32)
    values[0, :4] = [0.3, 1.0, 0.15, 0.65]
    path = result(tmp_path, "chair__a", photo(1), values)
    found = opened(path).infer(photo(1), people([[0, 0, 10, 10]]), NOBODY)
    np.testing.assert_allclose(found.probability[0, :5], [0.5, 1.0, 0.25, 0.75, 0.0], atol=1e-6)


def test_the_contact_is_that_of_the_largest_person(tmp_path: Path) -> None:
    path = result(tmp_path, "chair__a", photo(1), np.ones((1, 6890)))
    found = opened(path).infer(photo(1), people([[0, 0, 10, 10], [0, 0, 90, 90], [0, 0, 20, 20]]), NOBODY)
    np.testing.assert_allclose(found.probability.mean(axis=1), [0, 1, 0])


def test_several_results_of_a_photo_are_one(tmp_path: Path) -> None:
    first, second = np.zeros((1, 6890)), np.zeros((1, 6890))
    first[0, 0], second[0, 1] = 1, 1
    result(tmp_path, "chair__a", photo(1), first)
    result(tmp_path, "floor__a", photo(1), second)
    found = opened(tmp_path).infer(photo(1), people([[0, 0, 10, 10]]), NOBODY)
    np.testing.assert_allclose(found.probability[0, :3], [1, 1, 0])


def test_smplx_bodies_get_the_labels_on_smplx(tmp_path: Path) -> None:
    path = result(tmp_path, "chair__a", photo(1), np.zeros((1, 6890)), np.ones((1, 10475)))
    zero = np.zeros((1, 22, 3))
    bodies = Bodies(parameters_from_rotvecs(zero, np.zeros((1, 10)), np.zeros((1, 3))), "smplx")
    found = opened(path).infer(photo(1), people([[0, 0, 10, 10]]), bodies)
    assert found.topology == "smplx"
    assert found.probability.shape == (1, 10475)


def test_other_forms_of_files_are_read(tmp_path: Path, smpl_file: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps({"vertices": [3, 5]}))
    np.save(tmp_path / "b.npy", np.ones(6890))
    first = opened(tmp_path / "a.json", smpl_file=str(smpl_file)).infer(photo(1), people([[0, 0, 9, 9]]), NOBODY)
    assert np.flatnonzero(first.probability[0]).tolist() == [3, 5]
    assert first.rest is not None
    assert opened(tmp_path / "b.npy").infer(photo(1), people([[0, 0, 9, 9]]), NOBODY).probability.all()
    np.save(tmp_path / "c.npy", np.ones((2, 7)))
    with pytest.raises(BackendError, match=r"holds \(2, 7\), where contact is \(6890,\) on SMPL or \(10475,\)"):
        opened(tmp_path / "c.npy").infer(photo(1), people([[0, 0, 9, 9]]), NOBODY)


def test_the_fingerprint_depends_on_the_result_files(tmp_path: Path) -> None:
    path = result(tmp_path, "chair__a", photo(1), np.ones((1, 6890)))
    backend = InteractVlmResults(InteractVlmOptions(results=str(tmp_path)))
    before = backend.fingerprint()
    np.savez(path, pred_contact_3d_smplh=np.zeros((1, 6890)))
    assert backend.fingerprint() != before != ""
    assert InteractVlmResults().fingerprint() == ""


def test_missing_files_of_interactvlm_are_named(tmp_path: Path) -> None:
    for results, said in (("", "are not given"), (str(tmp_path / "no"), "there is no"), (str(tmp_path), "holds no")):
        backend = InteractVlmResults(InteractVlmOptions(results=results))
        assert said in backend.missing()[0]
        assert "run run_demo.py of https://github.com/saidwivedi/InteractVLM" in backend.missing()[0]
        with pytest.raises(WeightsMissingError):
            backend.load()
    np.savez(tmp_path / "x_hcontact_vertices.npz", a=np.ones(6890))
    with pytest.raises(BackendError, match=r"keep x\.jpg or \.png beside it"):
        opened(tmp_path)


class InteractVlmWithResults(InteractVlmResults):
    """Has the results of every world that it is shown, as if InteractVLM had run on it before."""

    def missing(self) -> tuple[str, ...]:
        return ()

    def load(self, device: str = "cpu") -> None:
        check_device(device)
        if self._results is not None:
            return
        self._rest, self._results = load_rest_mesh(self.options.smpl_file), ()

    def infer(self, image: np.ndarray, people: People, bodies: Bodies) -> ContactProbability:
        import tempfile

        world = world_of(image)
        if self._results is None or world is None or not len(people):
            return super().infer(image, people, bodies)
        rows = [int(np.abs(world.boxes - box).sum(axis=1).argmin()) for box in people.boxes]
        with tempfile.TemporaryDirectory() as folder:
            path = result(Path(folder), "chair__a", world.image, np.where(smpl_contact(world)[rows], 0.8, 0.1))
            mine = InteractVlmResults(self.options.model_copy(update={"results": str(path.parent)}))
            mine.load()
            return mine.infer(image, people, bodies)


@parametrize_with_checks(
    "contact_prior", InteractVlmWithResults, options=lambda world: OPTIONS | {"when_absent": "nothing"}
)
def test_interactvlm_conforms(check: Callable[[], None], smpl_file: Path) -> None:
    OPTIONS["smpl_file"] = str(smpl_file)
    check()


def test_labels_on_smpl_reach_the_embedded_body(smpl_file: Path) -> None:
    from physic_core.body import load_body
    from physic_core.body.convert.bodies import convert_contact
    from physic_testing.worlds import build_world

    world = build_world("walk")
    backend = DecoOnWorlds(DecoOptions(smpl_file=str(smpl_file)))
    backend.load()
    who = People(world.masks, world.boxes, np.ones(len(world.masks)))
    found = convert_contact(backend.infer(world.image, who, NOBODY), load_body("embedded")).probability
    predicted, true = found > 0.5, world.contact
    both = (predicted & true).sum()
    f1 = 2 * both / (predicted.sum() + true.sum())
    print(f"F1 of carried contact {f1:.2f}")
    assert f1 > 0.8
