"""Find weight files on this machine, by the name of a set or a path of the user."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from physic_core.errors import WeightsMissingError
from physic_core.weights.close_names import in_words, near
from physic_core.weights.folders import in_hub_cache, loose, own_folder, places_in_words, user_folders
from physic_core.weights.manifest import WeightFile, WeightSet, read_manifest

__all__ = ["Found", "fingerprint", "locate", "look", "missing", "other_sizes", "size_in_words", "way_to_get"]


@dataclass(frozen=True)
class Found:
    """The files of a set that are on this machine.

    Attributes:
        folder: folder with all files at their relative paths; None if there is no such folder.
        files: path relative to the set -> path on this machine, for the files that were found.
    """

    folder: Path | None
    files: Mapping[str, Path]


def locate(manifest: Path, value: str, file: str | None = None) -> Path:
    """Return the path of a weight file, or of the folder of a set.

    Args:
        manifest: the plugin's TOML file, or a folder of TOML files.
        value: the option ``weights``: the name of a set, or a path of the user.
        file: one file of the set or of the user's folder; None for the complete set.

    Returns:
        Path of the file. If ``file`` is None and the set has several files, or the user named a folder, path of the
        folder. If the user named a file, that path unchanged.

    Raises:
        WeightsMissingError: files are missing; the message lists the searched folders and how to get the files.
        BackendError: the manifest is invalid.
    """
    weights = read_manifest(manifest).get(value)
    if weights is None:
        return _own_path(manifest, value, file)
    if file is not None and file not in (known := [f.path for f in weights.files]):
        raise WeightsMissingError(
            f"weights '{value}' have no file {file}, only {', '.join(known)}: name those of this backend"
        )
    here = look(weights)
    lacking = [f.path for f in weights.files if f.path not in here.files and file in (None, f.path)]
    if not lacking:
        if file is not None or len(weights.files) == 1:
            return here.files[file if file is not None else weights.files[0].path]
        if here.folder is not None:
            return here.folder
    raise WeightsMissingError(f"{_lack(weights, lacking)}\nsought in {places_in_words(value)}")


def missing(manifest: Path, value: str, file: str | None = None) -> tuple[str, ...]:
    """List the files that :func:`locate` would not find, one line each with how to get it; empty if none.

    Raises:
        BackendError: the manifest is invalid.
    """
    try:
        locate(manifest, value, file)
    except WeightsMissingError as error:
        return (str(error).partition("\nsought in ")[0],)
    return ()


def fingerprint(manifest: Path, value: str) -> str:
    """Return a text that changes with the content of the weights, not with their path; "" if they are missing."""
    try:
        found = locate(manifest, value)
    except WeightsMissingError:
        return ""
    weights = read_manifest(manifest).get(value)
    if weights is not None:
        here = look(weights).files
        parts = [f"{file.path} {_identity(here[file.path], file)}" for file in weights.files]
    elif found.is_dir():
        inside = sorted(path for path in found.rglob("*") if path.is_file())
        parts = [f"{path.relative_to(found).as_posix()} {_identity(path)}" for path in inside]
    else:
        parts = [_identity(found)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def look(weights: WeightSet) -> Found:
    """Search all places for the files of a set; a place that has all of them is preferred."""
    pieces: dict[str, Path] = {}
    for found in _places(weights):
        if len(found) == len(weights.files):
            folder = _common_folder(found)
            if folder is not None or len(found) == 1:
                return Found(folder, found)
        for path, place in found.items():
            pieces.setdefault(path, place)
    return Found(None, pieces)


def other_sizes(weights: WeightSet) -> str:
    """Describe in one line the files whose size differs from the published one; "" if there are none.

    They may be the user's own files, and are used as they are.
    """
    here = look(weights).files
    sizes = [(file, here[file.path].stat().st_size) for file in weights.files if file.path in here]
    told = [
        f"{file.path} of {size} bytes where {file.bytes} are published"
        for file, size in sizes
        if file.bytes not in (None, size)
    ]
    return f"{', '.join(told)}: `physic weights verify {weights.name}`" if told else ""


def way_to_get(weights: WeightSet) -> str:
    """Describe how to get a set."""
    if not any(file.source for file in weights.files):
        return weights.advice
    command = f"`physic weights fetch {weights.name}"
    if weights.is_free:
        way = f"{command}`"
    else:
        why = "an account with access, " if weights.account else ""
        use = {True: "commercial use allowed", False: "no commercial use", None: "commercial use not said"}
        way = f"{command} --accept-licence` ({why}{use[weights.commercial]})"
    return way if all(file.source for file in weights.files) else f"{way}; {weights.advice}"


def size_in_words(size: int | None) -> str:
    """Format a size in bytes, as in "141 MB"; "" if it is None."""
    if size is None:
        return ""
    for unit, digits in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= unit:
            return f"{size / unit:.3g} {digits}" if size < 999.5 * unit else f"{size / unit:.0f} {digits}"
    return f"{size} bytes"


def _places(weights: WeightSet) -> list[dict[str, Path]]:
    """The files of a set that each searched place has, in the order of the search."""
    own = own_folder()
    candidates = [
        {file.path: folder / weights.name / file.path for file in weights.files}
        for folder in [*user_folders(), *([own] if own is not None else [])]
    ]
    places = [{path: place for path, place in candidate.items() if place.is_file()} for candidate in candidates]
    places += [_known({f.path: loose(folder, weights, f) for f in weights.files}) for folder in user_folders()]
    if not any(len(place) == len(weights.files) for place in places):  # Hugging Face's library takes time to import
        places.append(_known({file.path: in_hub_cache(file) for file in weights.files}))
    return places


def _known(places: Mapping[str, Path | None]) -> dict[str, Path]:
    return {path: place for path, place in places.items() if place is not None}


def _common_folder(found: Mapping[str, Path]) -> Path | None:
    """The folder that contains all files at their relative paths; None if there is none."""
    folders = set()
    for path, place in found.items():
        depth = len(Path(path).parts)
        if place.parts[-depth:] != Path(path).parts:
            return None
        folders.add(place.parents[depth - 1])
    return folders.pop() if len(folders) == 1 else None


def _lack(weights: WeightSet, lacking: list[str]) -> str:
    """Describe in one line the missing files of a set and how to get them."""
    facts = ", ".join(fact for fact in (size_in_words(weights.bytes), weights.license) if fact)
    if not lacking:
        what = " lie in several places, and have to be in one folder"
    elif len(lacking) < len(weights.files):
        what = f" lack {', '.join(lacking)}"
    else:
        what = " are not here"
    return f"weights '{weights.name}' ({facts}){what}: {way_to_get(weights)}"


def _own_path(manifest: Path, value: str, file: str | None) -> Path:
    """Path that the user gave instead of the name of a set."""
    path = Path(value).expanduser()
    if not value.strip():
        raise WeightsMissingError("no weights are named: give a name of `physic weights list`, or a path")
    if path.is_dir() and file is not None:
        if (path / file).is_file():
            return path / file
        raise WeightsMissingError(f"no file {file} in the folder {value}")
    if path.exists():
        return path
    if path.suffix or any(mark in value for mark in ("/", os.sep)):
        raise WeightsMissingError(f"no file or folder {value}")
    names = sorted(read_manifest(manifest))
    close = near(value, names)
    hint = f" Did you mean {in_words(close)}?" if close else f" There are: {', '.join(names) or 'none'}."
    raise WeightsMissingError(f"no weights are named '{value}', and no file or folder is.{hint}")


def _identity(path: Path, file: WeightFile | None = None) -> str:
    """The published hash of a file if known, else its size and modification time."""
    status = path.stat()
    if file is not None and file.sha256 is not None and file.bytes == status.st_size:
        return file.sha256
    return f"{status.st_size} {status.st_mtime_ns}"
