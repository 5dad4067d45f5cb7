"""The node of ComfyUI, loaded as ComfyUI loads a folder of custom nodes; ComfyUI itself is not
installed.
"""

from __future__ import annotations

import json
import os
import sys
from importlib.util import module_from_spec, spec_from_file_location
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_testing.worlds import load_world


@pytest.fixture
def nodes(repository, tmp_path, monkeypatch):
    def save_path(prefix, folder):
        subfolder, name = os.path.split(prefix)
        os.makedirs(os.path.join(folder, subfolder), exist_ok=True)
        return os.path.join(folder, subfolder), name, 1, subfolder, prefix

    paths = SimpleNamespace(
        get_output_directory=lambda: str(tmp_path), get_save_image_path=save_path
    )
    monkeypatch.setitem(sys.modules, "folder_paths", paths)
    folder = repository / "contrib" / "comfyui"
    spec = spec_from_file_location(str(folder), folder / "__init__.py")
    assert spec is not None
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, str(folder), module)
    spec.loader.exec_module(module)
    return module


def test_a_batch_gives_pictures_masks_files_and_contacts(nodes, tmp_path):
    config = tmp_path / "mock.toml"
    config.write_text(
        'extends = "mock"\n[run]\ncache = false\n[engine.joint.optimiser]\nsteps = 3\n'
    )
    world = load_world("sit_side_by_side", (160, 120))
    batch = torch.from_numpy(world.image.astype(np.float32) / 255)[None].repeat(2, 1, 1, 1)
    node = nodes.NODE_CLASS_MAPPINGS["PhysicReconstruct"]
    assert set(node.INPUT_TYPES()["required"]) == {"image", "preset", "focal_px", "filename_prefix"}
    done = getattr(node(), node.FUNCTION)(
        image=batch, preset=str(config), focal_px=0.0, filename_prefix="physic/scene"
    )
    assert len(done) == len(node.RETURN_TYPES) == len(node.RETURN_NAMES) == len(node.OUTPUT_IS_LIST)
    overlay, depth, masks, paths, contacts = done
    assert overlay.shape == depth.shape == batch.shape
    assert masks.shape == (4, 120, 160)
    for picture in (overlay, depth, masks):
        assert picture.dtype == torch.float32
        assert 0 <= picture.min() < picture.max() <= 1
    assert paths == ["physic/scene_00001_.glb", "physic/scene_00002_.glb"]
    assert all((tmp_path / path).read_bytes()[:4] == b"glTF" for path in paths)
    document = json.loads(contacts[0])
    assert len(document["people"]) == 2
    assert document["people"][0]["contacts"]
    assert document["nearest_depth_m"] > 0


def test_the_workflow_links_outputs_of_the_node(nodes, repository):
    workflow = json.loads((repository / "contrib/comfyui/workflow.json").read_text())
    (own,) = (
        key for key, one in workflow.items() if one["class_type"] in nodes.NODE_CLASS_MAPPINGS
    )
    node = nodes.NODE_CLASS_MAPPINGS[workflow[own]["class_type"]]
    assert workflow[own]["inputs"].keys() == node.INPUT_TYPES()["required"].keys()
    links = [
        value
        for one in workflow.values()
        for value in one["inputs"].values()
        if isinstance(value, list)
    ]
    assert sorted(slot for key, slot in links if key == own) == list(range(len(node.RETURN_TYPES)))
