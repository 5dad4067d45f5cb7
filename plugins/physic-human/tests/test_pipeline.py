"""The whole pipeline with perfect networks behind these backends, and mocks for the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from physic_core import BackendRecord, reconstruct
from physic_core.configuration.model import load_config
from physic_core.discovery.plugins import discover
from physic_testing.worlds import build_world

from .test_contact import DecoOnWorlds
from .test_depths import MogeOnWorlds, UniDepthOnWorlds
from .test_hands import WilorOnWorlds
from .test_nlf import NlfOnWorlds

TOLD: dict[str, dict[str, type[Any]]] = {
    "body_estimator": {"perfect-nlf": NlfOnWorlds},
    "hand_estimator": {"perfect-wilor": WilorOnWorlds},
    "contact_prior": {"perfect-deco": DecoOnWorlds},
    "relative_pointmap": {"perfect-moge-1": MogeOnWorlds},
    "metric_depth": {"perfect-unidepth": UniDepthOnWorlds},
}


MOST_MM = 115
"""Mean error of joints in two worlds, with the mocks' noise."""


def test_bodies_of_another_model_go_through_the_whole_pipeline(smpl_file: Path) -> None:
    """The presets' tests do the same with CameraHMR and SAM 3D Body."""
    registry = discover()
    for interface, kinds in TOLD.items():
        for name, kind in kinds.items():
            registry.register(BackendRecord(interface, name, kind, api=1))
    smpl = {"smpl_file": str(smpl_file)}
    config = {
        "run": {"cache": False},
        "body_estimator": {"backend": "perfect-nlf"},
        "hand_estimator": {"backend": "perfect-wilor", "options": {"least_size_px": 5}},
        "contact_prior": {"backend": "perfect-deco", "options": smpl},
        "relative_pointmap": {"backend": "perfect-moge-1"},
        "metric_depth": {"backend": "perfect-unidepth"},
    }
    apart = []
    for seed in (0, 1):
        world = build_world("sit_on_chair", seed)
        found = reconstruct(world.image, load_config(preset="mock", flags={"test": config}), registry=registry)
        assert found.body_model == "embedded"
        assert len(found.people) == len(world.vertices)
        joints = np.stack([person.joints for person in found.people])
        apart.append(1000 * np.linalg.norm(joints - world.joints, axis=2)[:, :22].mean())
        touching = np.stack([person.contact for person in found.people])
        precision = (touching & world.contact).sum() / max(touching.sum(), 1)
        recall = (touching & world.contact).sum() / world.contact.sum()
        print(f"{apart[-1]:.0f} mm, contact precision {precision:.2f} recall {recall:.2f}; {found.warnings}")
        assert any("converted from" in note for note in found.notes), found.notes
    assert np.mean(apart) < MOST_MM
