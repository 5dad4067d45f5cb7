"""Find the local folder of a model and check its files. Nothing is downloaded here."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from physic_core import weights
from physic_core.errors import BackendError, WeightsMissingError

MANIFEST = Path(__file__).parent / "weights"
"""Folder with the manifests of this plugin's weights."""

_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*")
_CONFIG = "config.json"
_WEIGHTS = ("model.safetensors", "model.safetensors.index.json", "pytorch_model.bin", "pytorch_model.bin.index.json")
_TOKENS = ("tokenizer.json", "vocab.txt", "vocab.json")
WEIGHTS_HELP = (
    "a name of `physic weights list`, a folder of your own, or owner/repository of what lies in Hugging Face's cache"
)
"""Description of the options that name weights."""


@dataclass(frozen=True)
class ModelSpec:
    """Network of a backend: name of its weights option, class in transformers and readable model types.

    Attributes:
        option: name of the option that names its weights.
        class_name: class in transformers.
        model_types: values of ``model_type`` in config.json that the class can read.
        needs_tokenizer: whether the network takes text.
    """

    option: str
    class_name: str
    model_types: tuple[str, ...]
    needs_tokenizer: bool = False


def find_folder(value: str) -> Path:
    """Return the local folder of a model.

    Args:
        value: a name in the manifest, a folder, or owner/repository of a model in Hugging Face's cache.

    Raises:
        WeightsMissingError: there is no such folder on this machine.
    """
    known = weights.read_manifest(MANIFEST)
    if value not in known and _HUB_ID.fullmatch(value) and not Path(value).exists():
        cached = _cached(value)
        if cached is not None:
            return cached
        same = [name for name, group in known.items() if any(f"://{value}/" in file.source for file in group.files)]
        advice = f"physic weights fetch {same[0]}" if same else f"hf download {value}"
        raise WeightsMissingError(
            f"'{value}' is not a folder here, and Hugging Face's cache does not hold it; nothing is fetched while a "
            f"photo is reconstructed: run `{advice}` first, or give a folder"
        )
    folder = weights.locate(MANIFEST, value)
    return folder if folder.is_dir() else folder.parent


def missing_network_files(spec: ModelSpec, value: str) -> tuple[str, ...]:
    """Describe the missing files of a network, fast and without network access."""
    known = weights.read_manifest(MANIFEST)
    if value in known:
        return weights.missing(MANIFEST, value)
    try:
        folder = find_folder(value)
    except WeightsMissingError as error:
        return (str(error),)
    wanted = [(_CONFIG,), _WEIGHTS, *([_TOKENS] if spec.needs_tokenizer else [])]
    return tuple(
        f"{folder} has no {' or '.join(names[:2])}: it must be a folder as save_pretrained of transformers writes it"
        for names in wanted
        if not any((folder / name).is_file() for name in names)
    )


def model_fingerprint(value: str) -> str:
    """Return the identity of a model's files, independent of their path; empty if they are missing."""
    if value in weights.read_manifest(MANIFEST) or not _HUB_ID.fullmatch(value) or Path(value).exists():
        return weights.fingerprint(MANIFEST, value)
    cached = _cached(value)
    return "" if cached is None else f"{value}@{cached.name}"  # a snapshot's folder is named after its commit


def check_model_type(folder: Path, spec: ModelSpec) -> None:
    """Raise BackendError if the folder contains another type of model.

    Raises:
        BackendError: its config.json cannot be read, or names another type.
    """
    try:
        found = json.loads((folder / _CONFIG).read_text("utf-8")).get("model_type")
    except (OSError, ValueError, AttributeError) as cause:
        raise BackendError(f"{folder / _CONFIG} cannot be read: {cause}") from cause
    if found not in spec.model_types:
        wanted = " or ".join(f"'{name}'" for name in spec.model_types)
        raise BackendError(f"{folder} holds a model of the type '{found}', expected {wanted} for {spec.class_name}")


def _cached(repository: str) -> Path | None:
    """Return the newest snapshot of a repository in Hugging Face's cache, or None."""
    from huggingface_hub import try_to_load_from_cache

    found = try_to_load_from_cache(repository, _CONFIG)
    return Path(found).parent if isinstance(found, str) else None
