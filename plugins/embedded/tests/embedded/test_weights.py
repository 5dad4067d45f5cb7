from __future__ import annotations

import hashlib
import json
import shutil

import numpy as np
import onnxruntime
import pytest

from physic_core.errors import BackendError
from physic_embedded.networks import sessions
from physic_embedded.networks.sessions import (
    WEIGHTS_FOLDER,
    PackagedBackend,
    open_packaged_session,
)

MANIFEST = json.loads((WEIGHTS_FOLDER / "MANIFEST.json").read_text())
MODELS = {entry["file"]: entry for entry in MANIFEST["models"]}
SMALL = "palm_detection_full"
DEPTH = "depth_anything_v2_vits_int8"


@pytest.mark.parametrize("name", sorted(MODELS))
def test_a_network_opens_with_the_inputs_of_the_manifest(name):
    session = open_packaged_session(name.removesuffix(".onnx"), threads=1)
    got = {i.name: list(i.shape) for i in session.session.get_inputs()}
    assert got == {i["name"]: i["shape"] for i in MODELS[name]["inputs"]}
    assert {o.name for o in session.session.get_outputs()} == {
        o["name"] for o in MODELS[name]["outputs"]
    }


def test_every_network_has_an_attribution_and_its_licence_text():
    notice = (WEIGHTS_FOLDER / "NOTICE").read_text()
    for name, model in MODELS.items():
        assert name in notice
        assert f"{model['source']['name']} {model['source']['version']}" in notice
    for licence, *words in (
        ("Apache-2.0", "Version 2.0, January 2004"),
        ("MIT-MI-GAN", "Picsart AI Research (PAIR)", "Permission is hereby granted"),
        ("MIT-TinyViT", "Microsoft Corporation", "Permission is hereby granted"),
    ):
        text = (WEIGHTS_FOLDER / "LICENSES" / f"{licence}.txt").read_text()
        assert all(word in text for word in words)


@pytest.fixture
def damaged_folder(tmp_path, monkeypatch):
    """A folder in place of the packaged one; it has only the manifest."""
    monkeypatch.setattr(sessions, "WEIGHTS_FOLDER", tmp_path)
    (tmp_path / "MANIFEST.json").write_text(json.dumps(MANIFEST))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "file"),
    [
        (SMALL, f"{SMALL}.onnx"),
        (DEPTH, "depth_anything_v2_vits.weights"),
    ],
)
def test_a_network_with_one_other_bit_is_refused(damaged_folder, name, file):
    shutil.copy(WEIGHTS_FOLDER / f"{name}.onnx", damaged_folder)
    content = bytearray((WEIGHTS_FOLDER / file).read_bytes())
    content[1_000_000] ^= 1
    (damaged_folder / file).write_bytes(content)
    found = hashlib.sha256(content).hexdigest()
    with pytest.raises(BackendError, match=f"{file} is damaged: .*{found}"):
        open_packaged_session(name)


def test_the_weights_that_were_compared_are_those_that_are_used(damaged_folder, monkeypatch):
    weights = damaged_folder / "depth_anything_v2_vits.weights"
    for file in (f"{DEPTH}.onnx", weights.name):
        shutil.copy(WEIGHTS_FOLDER / file, damaged_folder)
    image = {"image": np.random.default_rng(0).random((1, 3, 126, 126), np.float32)}
    [expected] = open_packaged_session(DEPTH, threads=1).run(["depth"], image)
    real = onnxruntime.InferenceSession

    def overwrite_and_open(*arguments, **options):
        with weights.open("r+b") as file:
            file.write(bytes(weights.stat().st_size))
        return real(*arguments, **options)

    monkeypatch.setattr(onnxruntime, "InferenceSession", overwrite_and_open)
    [found] = open_packaged_session(DEPTH, threads=1).run(["depth"], image)
    np.testing.assert_array_equal(found, expected)


def test_a_manifest_without_the_network_is_refused(damaged_folder):
    shutil.copy(WEIGHTS_FOLDER / f"{SMALL}.onnx", damaged_folder)
    (damaged_folder / "MANIFEST.json").write_text(
        '{"models": [{"file": "other.onnx"}], "weights": []}'
    )
    with pytest.raises(BackendError, match=f"no SHA-256 of {SMALL}"):
        open_packaged_session(SMALL)


def test_memory_is_released_while_a_network_is_open():
    session = open_packaged_session(SMALL, threads=1)
    image = {"image": np.random.default_rng(0).random((1, 192, 192, 3), np.float32)}
    before = session.run(["scores"], image)[0]
    for _ in range(2):
        PackagedBackend.release_memory()
    np.testing.assert_array_equal(session.run(["scores"], image)[0], before)
