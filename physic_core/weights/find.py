"""Find weight files on this machine by the name of a weight set."""

from __future__ import annotations

import hashlib
import os
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from physic_core.cache.digests import file_stamp, remembered_sha256
from physic_core.cache.folders import cache_folder
from physic_core.discovery.error_text import did_you_mean
from physic_core.errors import BackendError, WeightsMissingError
from physic_core.weights.manifest import HubSource, WeightFile, WeightSet, read_manifest

FOLDERS_VARIABLE = "PHYSIC_WEIGHTS"
"""Environment variable with folders of the user, separated as in ``PATH``."""


def locate(manifest: Path, name: str, file: str | None = None) -> Path:
    """Return the path of a weight file, or of the folder of a weight set, after a comparison with
    its SHA-256.

    Args:
        manifest: the plugin's TOML file, or a folder of TOML files.
        name: the option ``weights``: the name of a set.
        file: one file of the set; None for the complete set.

    Returns:
        Path of the file. If ``file`` is None and the set has several files, path of the folder.

    Raises:
        WeightsMissingError: files are missing; the message lists the searched folders and how to
            get the files.
        BackendError: a file is not the published one, or the manifest is invalid.
    """
    path = find_weights(manifest, name, file)
    weights = _weight_set_named(manifest, name)
    local_files = locate_files(weights)
    for wanted in weights.files:
        used = file in (None, wanted.path)
        if used and (wrong := describe_mismatch(local_files[wanted.path], wanted)):
            raise BackendError(
                f"{local_files[wanted.path]} is not the published file: {wrong}: move it away, "
                f"then {weights.how_to_get()}"
            )
    return path


def find_weights(manifest: Path, name: str, file: str | None = None) -> Path:
    """Return the path of :func:`locate`, without reading the file.

    Raises:
        WeightsMissingError: as in :func:`locate`.
        BackendError: the manifest is invalid.
    """
    weights = _weight_set_named(manifest, name)
    if file is not None and file not in (known := [f.path for f in weights.files]):
        raise WeightsMissingError(
            f"weights '{name}' have no file {file}, only {', '.join(known)}: choose weights of "
            f"this backend"
        )
    local_files = locate_files(weights)
    lacking = [
        f.path for f in weights.files if f.path not in local_files and file in (None, f.path)
    ]
    if not lacking:
        if file is not None or len(weights.files) == 1:
            return local_files[file if file is not None else weights.files[0].path]
        if (folder := common_folder(local_files)) is not None:
            return folder
    facts = ", ".join(fact for fact in (format_size(weights.bytes), weights.license) if fact)
    part = f"lack {', '.join(lacking)}" if len(lacking) < len(weights.files) else "are missing"
    what = part if lacking else "are in several folders"
    searched = [str(folder / name) for folder in search_folders()]
    if find_spec("huggingface_hub") is not None:
        searched.append("Hugging Face's cache")
    raise WeightsMissingError(
        f"weights '{name}' ({facts}) {what}: {weights.how_to_get()}\nsearched: "
        f"{', '.join(searched)}"
    )


def missing(manifest: Path, name: str, file: str | None = None) -> tuple[str, ...]:
    """Return a message about the files that :func:`locate` does not find, without reading one;
    empty if no file is missing.

    Raises:
        BackendError: the manifest is invalid.
    """
    try:
        find_weights(manifest, name, file)
    except WeightsMissingError as error:
        return (str(error).partition("\nsearched: ")[0],)
    return ()


def _weight_set_named(manifest: Path, name: str) -> WeightSet:
    """Return the set of a name, or raise WeightsMissingError."""
    sets = read_manifest(manifest)
    if name in sets:
        return sets[name]
    hint = did_you_mean(name, sets) or f"; there are: {', '.join(sorted(sets)) or 'none'}"
    raise WeightsMissingError(
        f"no weights are named '{name}'{hint}. If you have the published "
        f"file, put it at FOLDER/NAME/FILE, and set PHYSIC_WEIGHTS=FOLDER"
    )


def fingerprint(manifest: Path, name: str) -> str:
    """Return a digest of the content of the weights, independent of their path; "" if they are
    missing.

    Files without a published SHA-256 are read once, and again when they change.
    """
    try:
        find_weights(manifest, name)
    except WeightsMissingError:
        return ""
    weights = _weight_set_named(manifest, name)
    here = locate_files(weights)
    parts = [f"{file.path} {_file_identity(here[file.path], file)}" for file in weights.files]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def search_folders() -> list[Path]:
    """Return the folders in the environment variable ``PHYSIC_WEIGHTS``, then the user's cache
    folder.
    """
    texts = os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep)
    own = cache_folder("weights")
    return [Path(text).expanduser() for text in texts if text.strip()] + (
        [] if own is None else [own]
    )


def locate_files(weights: WeightSet) -> Mapping[str, Path]:
    """Return the files of a weight set on this machine, by path relative to the set.

    A folder with all of them is preferred.
    """
    places = []
    for folder in search_folders():
        inside = {file.path: folder / weights.name / file.path for file in weights.files}
        places.append({path: place for path, place in inside.items() if place.is_file()})
    # saves the slow import of huggingface_hub
    if not any(len(place) == len(weights.files) for place in places):
        places.append(
            {file.path: found for file in weights.files if (found := find_in_hub_cache(file))}
        )
    complete = (place for place in places if len(place) == len(weights.files))
    return next(complete, ChainMap(*places))


def presence(weights: WeightSet) -> Literal["missing", "in part", "here", "here, DIFFERS"]:
    """Return whether a weight set is on this machine; sizes are compared, not hashes."""
    here = locate_files(weights)
    if not here:
        return "missing"
    if len(here) < len(weights.files):
        return "in part"
    sizes = [file.bytes in (None, here[file.path].stat().st_size) for file in weights.files]
    return "here" if all(sizes) else "here, DIFFERS"


def common_folder(files: Mapping[str, Path]) -> Path | None:
    """Return the folder with several files at their relative paths; None if there is none."""
    folders = {str(place).removesuffix(str(Path(path))) for path, place in files.items()}
    return (
        Path(*folders) if len(files) > 1 and len(folders) == 1 and os.path.isdir(*folders) else None
    )


def describe_mismatch(path: Path, file: WeightFile) -> str:
    """Describe how the size or SHA-256 of a file differs from its manifest; "" if they match.

    A file is read once in a process, until it changes: a record on disk would hide later damage.
    """
    try:
        status = path.stat()
        if file.bytes not in (None, status.st_size):
            return f"it has {status.st_size} bytes instead of {file.bytes}"
        stamp = f"{status.st_dev} {file_stamp(status)}"
        if file.sha256 is not None and (sha256 := _sha256(path, stamp)) != file.sha256:
            return f"its SHA-256 is {sha256} instead of {file.sha256}"
    except OSError as error:
        return f"it cannot be read: {error.strerror}"
    return ""


@lru_cache(maxsize=1000)
def _sha256(path: Path, stamp: str) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def size_mismatches(weights: WeightSet) -> str:
    """List the weight files whose size differs from the published size, as one line; "" if there
    are none.
    """
    here = locate_files(weights)
    texts = [
        f"{here[file.path]}: {wrong}"
        for file in weights.files
        if file.path in here
        and (wrong := describe_mismatch(here[file.path], replace(file, sha256=None)))
    ]
    return f"{', '.join(texts)}: `physic weights verify {weights.name}`" if texts else ""


def format_size(size: int | None) -> str:
    """Format a number of bytes as in "141 MB"; "" if it is None."""
    if size is None:
        return ""
    for unit, digits in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= unit:
            return (
                f"{size / unit:.3g} {digits}"
                if size < 999.5 * unit
                else f"{size / unit:.0f} {digits}"
            )
    return f"{size} bytes"


def find_in_hub_cache(file: WeightFile) -> Path | None:
    """Return the path of a file in the cache of Hugging Face, or None if it is not in the cache."""
    origin = file.origin
    if not isinstance(origin, HubSource) or find_spec("huggingface_hub") is None:
        return None
    from huggingface_hub import constants

    folder = f"models--{origin.repository.replace('/', '--')}"
    if not Path(constants.HF_HUB_CACHE, folder).is_dir():
        return None  # saves the slow import of the rest of the library
    from huggingface_hub import try_to_load_from_cache

    path = try_to_load_from_cache(origin.repository, origin.path, revision=origin.revision)
    return Path(path) if isinstance(path, str) else None


def _file_identity(path: Path, file: WeightFile) -> str:
    """Return the published SHA-256 of a file, which is compared when the file is loaded; without
    one, its own.
    """
    if file.sha256 is not None and file.bytes == path.stat().st_size:
        return file.sha256
    return remembered_sha256(path)
