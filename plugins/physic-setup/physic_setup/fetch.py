"""Download the missing files of a weight set and verify their size and SHA-256."""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

from physic_core.errors import DownloadError
from physic_core.weights.folders import default_download_folder
from physic_core.weights.locate import format_licence, locate_files
from physic_core.weights.lock import locked
from physic_core.weights.manifest import HubSource, WebSource, WeightFile, WeightSet
from physic_core.weights.verify import describe_mismatch
from physic_setup.hub import download_from_hub
from physic_setup.pins import pin_files
from physic_setup.transfer import ResumableDownload, require_room, wrap_write_errors

__all__ = ["Progress", "fetch"]

Progress = Callable[[str, int, int | None], None]
"""Callback with the path of a file in its set, the bytes downloaded so far, and the total if known."""

_ARCHIVES = ".archives"


def fetch(
    weights: WeightSet,
    *,
    accept: bool = False,
    to: Path | None = None,
    progress: Progress = lambda name, done, total: None,
) -> tuple[str, ...]:
    """Download the missing files of a weight set.

    Args:
        weights: the set.
        accept: whether the user accepts a licence that restricts use or requires an account.
        to: folder for the complete set, as ``<to>/<set>/<file>``. None for the default: the cache of Hugging Face if
            the files come from one of its repositories with the same relative paths, else the user's cache folder.
        progress: called during a download.

    Returns:
        Paths of the downloaded files, relative to the set.

    Raises:
        DownloadError: the licence is not accepted, a file has no source, or a download failed. Partial downloads are
            kept.
    """
    weights = locked(weights)
    missing_files = _missing_files(weights, to)
    if not missing_files:
        _pin(weights, to)
        return ()
    by_hand = [file for file in missing_files if not file.source]
    if len(by_hand) == len(missing_files):
        raise DownloadError(
            f"{_names(by_hand)} of '{weights.name}' cannot be downloaded: {_manual_instructions(weights, to)}"
        )
    if not (accept or weights.is_free):
        raise DownloadError(
            f"'{weights.name}' is not downloaded without --accept-licence:\n{format_licence(weights)}\n"
            f"to accept the licence: physic weights fetch {weights.name} --accept-licence"
        )
    folder = _folder(to) / weights.name
    in_hubs_cache = to is None and _fits_hub_cache(weights)
    fetched = []
    for file in missing_files:
        if file.source:
            _fetch_file(weights, file, folder, in_hubs_cache, progress)
            fetched.append(file.path)
    shutil.rmtree(folder / _ARCHIVES, ignore_errors=True)
    _pin(weights, to)
    if by_hand:
        raise DownloadError(
            f"'{weights.name}': {_names([f for f in missing_files if f.source])} downloaded; "
            f"{_names(by_hand)} cannot be: {_manual_instructions(weights, to)}"
        )
    return tuple(fetched)


def _pin(weights: WeightSet, to: Path | None) -> None:
    """Add the files that are here to the lock file if nothing else pins them."""
    inside = {file.path: to / weights.name / file.path for file in weights.files} if to is not None else None
    here = locate_files(weights).files if inside is None else {p: f for p, f in inside.items() if f.is_file()}
    pin_files(weights, here)


def _missing_files(weights: WeightSet, to: Path | None) -> list[WeightFile]:
    if to is not None:
        inside = {file.path: to / weights.name / file.path for file in weights.files}
        _refuse_other_sizes(weights, {path: place for path, place in inside.items() if place.is_file()})
        return [file for file in weights.files if not inside[file.path].is_file()]
    here = locate_files(weights)
    _refuse_other_sizes(weights, here.files)
    missing_files = [file for file in weights.files if file.path not in here.files]
    if missing_files or len(weights.files) == 1 or here.folder is not None:
        return missing_files
    folder = _folder(None) / weights.name  # all files are here, but in several folders
    return [file for file in weights.files if not (folder / file.path).is_file()]


def _refuse_other_sizes(weights: WeightSet, here: Mapping[str, Path]) -> None:
    """Raise DownloadError if an existing file has another size than published; such a file is never replaced."""
    for file in weights.files:
        path = here.get(file.path)
        if path is not None and file.bytes not in (None, size := path.stat().st_size):
            raise DownloadError(
                f"{path} has {size} bytes instead of {file.bytes}, so it is not the published file: move it away, and "
                "try again"
            )


def _folder(to: Path | None) -> Path:
    folder = default_download_folder() if to is None else to
    if folder is None:
        raise DownloadError("there is no home folder for weights: choose a folder with --to")
    return folder


def _manual_instructions(weights: WeightSet, to: Path | None) -> str:
    return f"{weights.advice.rstrip('. ')}; then copy it into {_folder(to) / weights.name}"


def _names(files: list[WeightFile]) -> str:
    return ", ".join(file.path for file in files)


def _fits_hub_cache(weights: WeightSet) -> bool:
    """Return whether all files are in one repository of Hugging Face with the same relative paths."""
    places = set()
    for file in weights.files:
        origin = file.origin
        if not isinstance(origin, HubSource) or not f"/{origin.path}".endswith(f"/{file.path}"):
            return len(weights.files) == 1 and isinstance(origin, HubSource)
        places.add((origin.repository, origin.revision, origin.path.removesuffix(file.path)))
    return len(places) == 1


def _fetch_file(weights: WeightSet, file: WeightFile, folder: Path, in_hubs_cache: bool, progress: Progress) -> None:
    def report(done: int, total: int | None) -> None:
        progress(file.path, done, total if total is not None else file.bytes)

    target = folder / file.path
    if not in_hubs_cache and _copy_if_valid(locate_files(weights).files.get(file.path), file, target):
        return
    origin = file.origin
    advice = f"see {weights.homepage}" if weights.homepage else ""
    if isinstance(origin, HubSource):
        download_from_hub(file, None if in_hubs_cache else target, report, advice)
        return
    assert isinstance(origin, WebSource)
    if weights.account:
        advice = f"{format_licence(weights).strip()}\n{_browser_instructions(target)}"
    with wrap_write_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    if not origin.member:
        _download(origin.url, target, file, report, advice)
        return
    name = Path(origin.url.partition("?")[0]).name
    archive = folder / _ARCHIVES / (name if name.endswith(".zip") else f"{name}.zip")
    if not archive.is_file():
        with wrap_write_errors(archive):
            archive.parent.mkdir(parents=True, exist_ok=True)
        _download(origin.url, archive, WeightFile(archive.name), report, advice)
    _extract_member(archive, origin, file, target)


def _copy_if_valid(here: Path | None, file: WeightFile, target: Path) -> bool:
    """Copy a valid existing file to ``target``; return False if there is none."""
    if here is None or describe_mismatch(here, file):
        return False
    part = target.with_name(f"{target.name}.copy")
    with wrap_write_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            shutil.copyfile(here, part)
            os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)
    return True


def _browser_instructions(target: Path) -> str:
    return f"or download it with a browser to {target}"


def _download(url: str, target: Path, file: WeightFile, report: Callable[[int, int | None], None], advice: str) -> None:
    transfer = ResumableDownload(
        target.with_name(f"{target.name}.part"),
        file.bytes,
        hashed=file.sha256 is not None,
        advice=advice,
        report=report,
    )
    transfer.fetch(url, target, lambda path: describe_mismatch(path, file), advice)


def _extract_member(archive: Path, origin: WebSource, file: WeightFile, target: Path) -> None:
    """Extract one file of a zip archive to ``target``; names in the archive never determine the path."""
    part = target.with_name(f"{target.name}.member")
    try:
        with zipfile.ZipFile(archive) as opened:
            member, wrong = _find_member(opened, origin, file)
            if not wrong:
                require_room(part.parent, opened.getinfo(member).file_size)
                with opened.open(member) as inside, part.open("wb") as out:
                    _copy(inside, out, part)
                if wrong := describe_mismatch(part, file):
                    wrong = f"{origin.url}#{origin.member} was extracted, but {wrong}: removed"
        if not wrong:
            with wrap_write_errors(target):
                os.replace(part, target)
    except DownloadError:
        raise
    except Exception as error:  # of zipfile and its decompressors, which share no base class
        reason = ascii(str(error))[1:-1][:200]
        wrong = f"{origin.url} is not a readable zip archive ({reason}): removed"
    finally:
        part.unlink(missing_ok=True)
    if wrong:  # the archive is invalid or has another version
        shutil.rmtree(archive.parent, ignore_errors=True)
        raise DownloadError(wrong)


def _copy(inside: IO[bytes], out: IO[bytes], part: Path) -> None:
    while piece := inside.read(1 << 20):
        with wrap_write_errors(part):
            out.write(piece)


def _find_member(opened: zipfile.ZipFile, origin: WebSource, file: WeightFile) -> tuple[str, str]:
    """Find the member of a zip archive that the manifest names, with or without its folders.

    Returns:
        The name of the member, and an error text that is empty if there is no error.
    """
    names = [info.filename for info in opened.infolist() if not info.is_dir()]
    found = [origin.member] if origin.member in names else [n for n in names if n.endswith(f"/{origin.member}")]
    if not found:
        return "", f"{origin.url} does not contain {origin.member}, only {_abbreviate(names)}"
    if len(found) > 1:
        return (
            "",
            f"{origin.url} contains several {origin.member}; the manifest should name one: {_abbreviate(found)}",
        )
    size = opened.getinfo(found[0]).file_size
    if file.bytes not in (None, size):
        wrong = f"{origin.url}#{origin.member} has {size} bytes instead of {file.bytes}: it has changed"
        return "", wrong
    return found[0], ""


def _abbreviate(names: list[str]) -> str:
    shown = [name if name.isprintable() else ascii(name)[1:-1] for name in names[:8]]
    return ", ".join(shown) + (", ..." if len(names) > 8 else "")
