"""Weight manifests: sets of weights, or BackendError."""

from __future__ import annotations

import random
import tomllib
from collections.abc import Sequence
from pathlib import Path

from fuzzing.mutations import mutate_text
from fuzzing.target import Target
from physic_core.errors import BackendError
from physic_core.weights.find import format_size
from physic_core.weights.manifest import HubSource, is_inside, read_manifest

MANIFEST = """
[net-1]
summary = "A network"
license = "MIT"
commercial = true
account = false
homepage = "https://example.org/net"
advice = "export it"
[[net-1.files]]
path = "model.onnx"
bytes = 140852051
sha256 = "0000000000000000000000000000000000000000000000000000000000000007"
source = "hf://owner/net/model.onnx@main"
[[net-1.files]]
path = "deep/data.bin"
source = "https://example.org/net.zip#inside/data.bin"

["other.net"]
summary = "Another"
license = "CC BY-NC 4.0"
commercial = false
files = [{ path = "a.npz", bytes = 12 }]
advice = "copy it"
"""


def manifests(folder: Path) -> list[bytes]:
    return [MANIFEST.encode()]


def mutate_manifest(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    return mutate_text(data.decode(), rng).encode("utf-8", "replace")


def attack_manifest(data: bytes, folder: Path) -> None:
    path = folder / "weights.toml"
    path.write_bytes(data)
    try:
        sets = read_manifest(path)
    except BackendError:
        return
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    assert list(sets) == list(tables)
    for name, weights in sets.items():
        rows = tables[name]["files"]
        assert [(file.path, file.bytes, file.sha256) for file in weights.files] == [
            (row["path"], row.get("bytes"), row.get("sha256")) for row in rows
        ]
        assert (weights.license, weights.commercial) == (
            tables[name]["license"],
            tables[name].get("commercial"),
        )
        assert format_size(weights.bytes) is not None
        assert weights.how_to_get()
        assert (
            not any(isinstance(file.origin, HubSource) for file in weights.files)
            or weights.describe_licence()
        )
        assert all(is_inside(file.path) for file in weights.files)


TARGETS = [
    Target("weight_manifests", manifests, attack_manifest, mutate_manifest),
]
