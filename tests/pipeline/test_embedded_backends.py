"""The offline default on the example photo, with real networks: one man stands whole, one is cut at the hips."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from physic_core import Reconstruction, reconstruct
from physic_core.body import load_body
from physic_core.cli import main
from physic_core.engine.settings import ContactSettings
from physic_core.io.photo import read_photo
from physic_testing.bench.consistency import consistency

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def result() -> Reconstruction:
    return reconstruct(read_photo(EXAMPLES / "basketball.png").image)


def whole_and_cut(result: Reconstruction) -> tuple[int, int]:
    """The man on the left of the photo, and the one on its right."""
    first, second = np.argsort([person.box[0] for person in result.people])
    return int(first), int(second)


def test_both_men_are_found(result: Reconstruction) -> None:
    assert len(result.people) == 2
    whole, cut = whole_and_cut(result)
    assert result.people[whole].failed_checks == ()
    assert "legs_seen" in result.people[cut].failed_checks
    assert result.people[whole].joints[0, 2] > result.people[cut].joints[0, 2] > 0


def test_the_man_who_is_not_cut_off_stands_on_the_floor(result: Reconstruction) -> None:
    whole, _ = whole_and_cut(result)
    told = consistency(result, load_body())[whole]
    print(told)
    assert result.scene.floor is not None
    assert abs(told.sole_height) < 0.03
    assert told.keypoint_error_share < 0.02
    assert told.inside_share < 0.01
    assert abs(told.lean_deg) < 12
    ankles = result.people[whole].joints[7:9] @ result.scene.floor.normal + result.scene.floor.offset
    neck = float(result.people[whole].joints[12] @ result.scene.floor.normal + result.scene.floor.offset)
    assert neck - float(ankles.min()) > 1.0


def test_his_soles_touch_and_his_head_does_not(result: Reconstruction) -> None:
    whole, cut = whole_and_cut(result)
    model = load_body()
    contact = result.people[whole].contact
    for side in ("left", "right"):
        assert contact[model.contact_sets[f"{side}_sole"].numpy()].mean() > 0.5
    head = (model.part_of_vertex == model.part_names.index("head")).numpy()
    assert not contact[head].any()
    legs = [i for i, name in enumerate(model.part_names) if name.endswith(("lower_leg", "foot"))]
    unseen = np.isin(model.part_of_vertex.numpy(), legs)
    person = result.people[cut]
    assert person.contact_probability is not None
    least = ContactSettings().threshold - 1e-3  # float16
    assert (person.contact_probability[unseen & person.contact] >= least).all()


def test_every_stage_names_its_backend(result: Reconstruction) -> None:
    named = {s.provenance.interface for s in result.stages if s.provenance is not None}
    assert named == {
        "segmenter",
        "keypoint_detector",
        "inpainter",
        "relative_pointmap",
        "body_estimator",
        "hand_estimator",
        "contact_prior",
        "metric_depth",
    }
    assert all(s.provenance.weights_license for s in result.stages if s.name in ("people", "inpainting", "hands"))


def test_telea_takes_the_inpainters_place(tmp_path: Path) -> None:
    out = tmp_path / "out"
    config = str(EXAMPLES / "telea.toml")
    done = CliRunner().invoke(main, ["run", str(EXAMPLES / "basketball.png"), "--config", config, "-o", str(out)])
    assert done.exit_code == 0, done.output
    document = json.loads((out / "reconstruction.json").read_text())
    backends = {s["backend"]["interface"]: s["backend"] for s in document["stages"] if s["backend"]}
    assert backends["inpainter"]["name"] == "telea"
    assert backends["inpainter"]["distribution"] == "physic-opencv"
    assert backends["segmenter"]["name"] == "embedded"
    assert len(document["people"]) == 2
    assert {p.name for p in out.iterdir()} >= {"preview.png", "report.html", "combined.glb"}
    assert done.stdout.endswith(f"results: {out}/\npage: {out}/report.html\n")
