"""Weight manifests: sets of weights, or BackendError. Members of zip archives: the published file, or DownloadError."""

from __future__ import annotations

import hashlib
import io
import random
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

from fuzzing.mutations import mutate_text
from fuzzing.target import Target
from physic_core.errors import BackendError, DownloadError
from physic_core.weights.find import format_size
from physic_core.weights.manifest import HubSource, WebSource, WeightFile, is_inside, read_manifest
from physic_setup.fetch import _extract_member

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

CONTENT = bytes(range(256)) * 9
WANTED = WeightFile("data.bin", len(CONTENT), hashlib.sha256(CONTENT).hexdigest())


def manifests(folder: Path) -> list[bytes]:
    return [MANIFEST.encode()]


def mutate_manifest(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    return mutate_text(data.decode(), rng).encode("utf-8", "replace")


def attack_manifest(data: bytes, folder: Path) -> None:
    path = folder / "weights.toml"
    path.write_bytes(data)
    try:
        sets = read_manifest(path)
    except BackendError as error:
        lines = str(error).splitlines()
        assert all(line.isprintable() for line in lines)
        assert all(str(path) in line for line in lines[1:])
        return
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    assert list(sets) == list(tables)
    for name, weights in sets.items():
        rows = tables[name]["files"]
        assert [(file.path, file.bytes, file.sha256) for file in weights.files] == [
            (row["path"], row.get("bytes"), row.get("sha256")) for row in rows
        ]
        assert (weights.license, weights.commercial) == (tables[name]["license"], tables[name].get("commercial"))
        assert format_size(weights.bytes) is not None
        assert weights.how_to_get()
        assert not any(isinstance(file.origin, HubSource) for file in weights.files) or weights.describe_licence()
        assert all(is_inside(file.path) for file in weights.files)


def archives(folder: Path) -> list[bytes]:
    seeds = []
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", method) as archive:
            archive.writestr("../outside.bin", b"x")
            archive.writestr("inside/data.bin", CONTENT)
        seeds.append(file.getvalue())
    return seeds


def attack_archive(data: bytes, folder: Path) -> None:
    archive, target = folder / "archives" / "net.zip", folder / "set" / "data.bin"
    for path in (archive, target):
        path.parent.mkdir()
    archive.write_bytes(data)
    try:
        _extract_member(archive, WebSource("https://example.org/net.zip", "inside/data.bin"), WANTED, target)
        assert target.read_bytes() == CONTENT
    except DownloadError:
        assert not target.exists()
    assert not (folder / "outside.bin").exists()
    assert set(target.parent.iterdir()) <= {target}


TARGETS = [
    Target("weight_manifests", manifests, attack_manifest, mutate_manifest),
    Target("weight_archives", archives, attack_archive),
]
