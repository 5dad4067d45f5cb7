"""The bill of materials."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bill(tmp_path_factory):
    file = tmp_path_factory.mktemp("sbom") / "new" / "sbom.json"
    subprocess.run([sys.executable, str(ROOT / "tools" / "sbom.py"), str(file)], check=True)
    document = json.loads(file.read_text())
    return document


def is_list_of_others(name):
    """Return whether a distribution installs nothing but its metadata, so that there is nothing to
    license.
    """
    return all(file.parts[0].endswith(".dist-info") for file in distribution(name).files or ())


def test_every_component_states_a_licence(bill):
    names = [component["name"] for component in bill["components"]]
    assert {"metricbody", "metricbody-embedded", "numpy", "torch", "pydantic-core"} <= set(names)
    unstated = [
        component["name"] for component in bill["components"] if not component.get("licenses")
    ]
    assert [name for name in unstated if not is_list_of_others(name)] == []
    assert len(names) == len(set(names))


def test_every_network_and_the_body_have_their_digest(bill):
    digests = {c["name"]: c["hashes"][0]["content"] for c in bill["components"] if "hashes" in c}
    files = [
        *ROOT.glob("plugins/embedded/physic_embedded/weights/*.onnx"),
        *ROOT.glob("plugins/embedded/physic_embedded/weights/*.weights"),
        ROOT / "physic_core/body/embedded.npz",
    ]
    assert {"/".join(file.parts[-3:]) for file in files} == set(digests)
    for file in files:
        assert hashlib.sha256(file.read_bytes()).hexdigest() == digests["/".join(file.parts[-3:])]
