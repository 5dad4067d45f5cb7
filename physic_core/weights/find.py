"""Find weight files on this machine, by the name of a weight set or by a path of the user."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from physic_core.cache.file_hashes import remembered_sha256
from physic_core.cache.folders import cache_folder
from physic_core.discovery.close_names import format_choice, similar_names
from physic_core.errors import WeightsMissingError
from physic_core.weights.folders import (
    describe_search_folders,
    find_in_hub_cache,
    find_without_subfolder,
    user_folders,
)
from physic_core.weights.lock import locked, record_use
from physic_core.weights.manifest import WeightFile, WeightSet, read_manifest
from physic_core.weights.verify import require_published_sha256


@dataclass(frozen=True)
class LocatedFiles:
    """The files of a weight set that were found on this machine.

    Attributes:
        folder: folder with all files at their relative paths; None if there is no such folder.
        files: path on this machine by path relative to the set.
    """

    folder: Path | None
    files: Mapping[str, Path]


def locate(manifest: Path, value: str, file: str | None = None) -> Path:
    """Return the path of a weight file, or of the folder of a weight set, after a comparison with its SHA-256.

    A file of a set that is not the published one is refused. A path of the user is not compared with anything.

    Args:
        manifest: the plugin's TOML file, or a folder of TOML files.
        value: the option ``weights``: the name of a set, or a path of the user.
        file: one file of the set or of the user's folder; None for the complete set.

    Returns:
        Path of the file. If ``file`` is None and the set has several files, or the user named a folder, path of the
        folder. If the user named a file, that path unchanged.

    Raises:
        WeightsMissingError: files are missing; the message lists the searched folders and how to get the files.
        BackendError: a file is not the published one, or the manifest is invalid.
    """
    found = find_weights(manifest, value, file)
    weights = read_manifest(manifest).get(value)
    if weights is not None:
        here = locate_files(weights).files
        advice = (
            f"move it away, then {weights.how_to_get()}; to use a file of your own, give its path in place of '{value}'"
        )
        for wanted in weights.files:
            if file in (None, wanted.path):
                require_published_sha256(here[wanted.path], wanted, advice)
                record_use(f"{value}/{wanted.path}", here[wanted.path], wanted.sha256)
    return found


def find_weights(manifest: Path, value: str, file: str | None = None) -> Path:
    """Return the path of :func:`locate`, without reading the file.

    Raises:
        WeightsMissingError: as in :func:`locate`.
        BackendError: the manifest is invalid.
    """
    weights = read_manifest(manifest).get(value)
    if weights is None:
        return _path_of_user(manifest, value, file)
    if file is not None and file not in (known := [f.path for f in weights.files]):
        raise WeightsMissingError(
            f"weights '{value}' have no file {file}, only {', '.join(known)}: choose weights of this backend"
        )
    here = locate_files(weights)
    missing_paths = [f.path for f in weights.files if f.path not in here.files and file in (None, f.path)]
    if not missing_paths:
        if file is not None or len(weights.files) == 1:
            return here.files[file if file is not None else weights.files[0].path]
        if here.folder is not None:
            return here.folder
    raise WeightsMissingError(
        f"{_describe_missing(weights, missing_paths)}\nsearched: {describe_search_folders(value)}"
    )


def missing(manifest: Path, value: str, file: str | None = None) -> tuple[str, ...]:
    """Return a message about the files that :func:`locate` does not find; empty if no file is missing. Reads no file.

    Raises:
        BackendError: the manifest is invalid.
    """
    try:
        find_weights(manifest, value, file)
    except WeightsMissingError as error:
        return (str(error).partition("\nsearched: ")[0],)
    return ()


def fingerprint(manifest: Path, value: str) -> str:
    """Return a digest of the content of the weights, independent of their path; "" if they are missing.

    Files without a published SHA-256 are read once, and again when they change.
    """
    try:
        found = find_weights(manifest, value)
    except WeightsMissingError:
        return ""
    weights = read_manifest(manifest).get(value)
    if weights is not None:
        here = locate_files(weights).files
        parts = [f"{file.path} {_identity(here[file.path], file)}" for file in weights.files]
    elif found.is_dir():
        inside = sorted(path for path in found.rglob("*") if path.is_file())
        parts = [f"{path.relative_to(found).as_posix()} {_identity(path)}" for path in inside]
    else:
        parts = [_identity(found)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def locate_files(weights: WeightSet) -> LocatedFiles:
    """Search all folders for the files of a weight set; a folder with all of them is preferred."""
    pieces: dict[str, Path] = {}
    for found in _places(weights):
        if len(found) == len(weights.files):
            folder = _common_folder(found)
            if folder is not None or len(found) == 1:
                return LocatedFiles(folder, found)
        for path, place in found.items():
            pieces.setdefault(path, place)
    return LocatedFiles(None, pieces)


def size_mismatches(weights: WeightSet) -> str:
    """List the weight files whose size differs from the published size, as one line; "" if there are none."""
    here = locate_files(weights).files
    sizes = [(file, here[file.path].stat().st_size) for file in weights.files if file.path in here]
    texts = [
        f"{file.path} has {size} bytes instead of the published {file.bytes}"
        for file, size in sizes
        if file.bytes not in (None, size)
    ]
    return f"{', '.join(texts)}: `physic weights verify {weights.name}`" if texts else ""


def format_size(size: int | None) -> str:
    """Format a number of bytes as in "141 MB"; "" if it is None."""
    if size is None:
        return ""
    for unit, digits in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= unit:
            return f"{size / unit:.3g} {digits}" if size < 999.5 * unit else f"{size / unit:.0f} {digits}"
    return f"{size} bytes"


def _places(weights: WeightSet) -> list[dict[str, Path]]:
    """List the files of a weight set in each searched folder, in search order."""
    own = cache_folder("weights")
    candidates = [
        {file.path: folder / weights.name / file.path for file in weights.files}
        for folder in [*user_folders(), *([own] if own is not None else [])]
    ]
    places = [{path: place for path, place in candidate.items() if place.is_file()} for candidate in candidates]
    places += [
        _without_none({f.path: find_without_subfolder(folder, weights, f) for f in weights.files})
        for folder in user_folders()
    ]
    if not any(len(place) == len(weights.files) for place in places):  # saves the slow import of huggingface_hub
        for variant in (locked(weights), weights):
            places.append(_without_none({file.path: find_in_hub_cache(file) for file in variant.files}))
    return places


def _without_none(places: Mapping[str, Path | None]) -> dict[str, Path]:
    return {path: place for path, place in places.items() if place is not None}


def _common_folder(found: Mapping[str, Path]) -> Path | None:
    """Return the folder that contains all files at their relative paths, or None."""
    folders = set()
    for path, place in found.items():
        depth = len(Path(path).parts)
        if place.parts[-depth:] != Path(path).parts:
            return None
        folders.add(place.parents[depth - 1])
    return folders.pop() if len(folders) == 1 else None


def _describe_missing(weights: WeightSet, missing_paths: list[str]) -> str:
    """Format one line about the missing files of a weight set, and how to get them."""
    facts = ", ".join(fact for fact in (format_size(weights.bytes), weights.license) if fact)
    if not missing_paths:
        what = " are in several folders, and must be in one folder"
    elif len(missing_paths) < len(weights.files):
        what = f" lack {', '.join(missing_paths)}"
    else:
        what = " are missing"
    return f"weights '{weights.name}' ({facts}){what}: {weights.how_to_get()}"


def _path_of_user(manifest: Path, value: str, file: str | None) -> Path:
    """Return the path that the user gave instead of the name of a weight set, or raise WeightsMissingError."""
    path = Path(os.path.expanduser(value))
    if not value.strip():
        raise WeightsMissingError(
            "the option weights is empty: set it to a name of `physic weights list`, or to a path"
        )
    if path.is_dir() and file is not None:
        if (path / file).is_file():
            return path / file
        raise WeightsMissingError(f"no file {file} in the folder {value}")
    if path.exists():
        return path
    if path.suffix or any(mark in value for mark in ("/", os.sep)):
        raise WeightsMissingError(f"no file or folder {value}")
    names = sorted(read_manifest(manifest))
    close = similar_names(value, names)
    hint = f" Did you mean {format_choice(close)}?" if close else f" There are: {', '.join(names) or 'none'}."
    raise WeightsMissingError(f"no weight set, file or folder is named '{value}'.{hint}")


def _identity(path: Path, file: WeightFile | None = None) -> str:
    """Return the published SHA-256 of a file, which is compared when the file is loaded; without one, its own."""
    if file is not None and file.sha256 is not None and file.bytes == path.stat().st_size:
        return file.sha256
    return remembered_sha256(path)
