"""Configurations, however they come in: a valid one that can be written and read again, or one short ConfigError."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from fuzzing.mutations import mutate_text
from fuzzing.target import Target
from physic_core.batch.photos import list_photos
from physic_core.cli.config import config_toml
from physic_core.configuration.model import Config, as_config, load_config
from physic_core.configuration.resolve import load_checked_config
from physic_core.discovery.plugins import discover
from physic_core.discovery.registry import Registry
from physic_core.errors import PhysicError
from physic_core.files.strict_json import to_json

MAX_BYTES = 4096

TOML = """
extends = "mock"
[inpainter]
backend = "physic-opencv:telea"
options = { radius_px = 3.0 }
[metric_depth]
backend = "mock"
[photo]
max_side = 640
mask_growth = 0.01
intrinsics = [800.0, 810.0, 320.0, 240.0]
distortion = [0.1, 0.0, 0.0, 0.0, 0.0]
person = [[10, 20.5]]
box = [[1, 2, 30, 40]]
stature = [1.7, 0]
camera_height = 1.5
known_length = [[1, 2, 30, 40, 0.5]]
masks = "masks.png"
[body_model]
path = "~/SMPLX_NEUTRAL.npz"
[engine]
preset = "default"
[engine.scene]
floor = "off"
far_m = inf
[engine.joint]
frozen = ["hands"]
optimiser = { steps = 3, refresh_steps = 2 }
contact = { weight = 1.0, source = "prior" }
[run]
device = "cpu"
threads = 1
cache_mb = 10
"""
SETS = """photo.max_side=640
inpainter.backend=telea
inpainter.options.radius_px=3.0
photo.focal_px=900
engine.preset=paper
engine.joint.contact.weight=2
run.device='cuda:1'
photo.masks=~/masks.png"""
TABLE = 'path,camera,stature,id\na.jpg,"800,800,320,240",1.7,a\nb.jpg,900,"1.7 1.8",b\nc.jpg,,,\n'


def make_seeds(folder: Path) -> list[bytes]:
    """The first line names the way in."""
    tables = to_json(load_config(preset="mock", environment={}, overrides=["engine.scene.far_m=inf"]).as_dict())
    variables = "\n".join(
        f"PHYSIC__{key.replace('.', '__').upper()}={value}"
        for key, _, value in (line.partition("=") for line in SETS.splitlines())
    )
    parts = {
        "toml": TOML,
        "extended": TOML,
        "json": json.dumps({"config": tables}),
        "mapping": json.dumps(tables),
        "mapping of a preset": json.dumps({"extends": "light-cpu", "photo": {"max_side": 300}}),
        "set": SETS,
        "variables": variables,
        "preset": "light-cpu",
        "path": "base.toml",
        "table": TABLE,
    }
    return [f"{name}\n{text}".encode() for name, text in parts.items()]


def mutate(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    head, _, text = data.partition(b"\n")
    return head + b"\n" + mutate_text(text.decode(), rng).encode(errors="surrogatepass")


@cache
def registry() -> Registry:
    return discover()


def attack(data: bytes, folder: Path) -> None:
    head, _, content = data.partition(b"\n")
    (folder / "base.toml").write_text('extends = "mock"\n')
    text = content.decode(errors="surrogateescape")
    way = head.decode(errors="replace").partition(" ")[0]
    try:
        config = read(way, content, text, folder)
    except PhysicError as error:
        check_message(str(error))
        return
    if config is not None:
        check_config(config, folder)


def read(way: str, content: bytes, text: str, folder: Path) -> Config | None:
    file = folder / "physic.toml"
    match way:
        case "extended":
            (folder / "other.toml").write_bytes(content)
            file.write_text('extends = "other.toml"\n[photo]\nmax_side = 500\n')
        case "json":
            file = folder / "reconstruction.json"
            file.write_bytes(content)
        case "mapping":
            try:
                tables = json.loads(text)
            except (ValueError, RecursionError):
                return None
            return as_config(tables)
        case "set":
            return load_checked_config(registry(), preset="mock", overrides=text.splitlines(), environment={})
        case "variables":
            pairs = (line.partition("=") for line in text.splitlines())
            environment = {name: value for name, _, value in pairs}
            return load_checked_config(registry(), preset="mock", environment=environment)
        case "preset":
            return load_checked_config(registry(), preset=text, environment={})
        case "path":
            return load_checked_config(registry(), folder / text, environment={})
        case "table":
            (folder / "photos.csv").write_bytes(content)
            config = load_config(preset="mock", environment={})
            for item in list_photos([str(folder / "photos.csv")]).photos:
                config = config.with_photo(item.settings)
            return config
        case _:
            file.write_bytes(content)
    return load_checked_config(registry(), file, environment={})


def check_message(text: str) -> None:
    assert 0 < len(text.encode()) <= MAX_BYTES, f"{len(text.encode())} bytes"
    assert all(c.isprintable() or c in "\n\t" for c in text), ascii(text)


def check_config(config: Config, folder: Path) -> None:
    """Written as TOML, as JSON and as ``config show`` prints it, it is the same again."""
    assert config.photo.known_sizes() is not None
    assert config.engine.settings() is not None
    tables = config.as_dict()
    (folder / "shown.toml").write_text(config_toml(config))
    (folder / "again.json").write_text(text := json.dumps({"config": to_json(tables)}))
    has_surrogates = "\\udc" in text  # a path that is not UTF-8, which TOML cannot express
    for name in ("again.json",) if has_surrogates else ("shown.toml", "again.json"):
        again = load_config(folder / name, environment={})
        assert to_json(again.as_dict()) == to_json(tables), name


TARGETS = [Target("configs", make_seeds, attack, mutate)]
