"""Download the missing files of a weight set and verify their size and SHA-256."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

from physic_core.cache.folders import cache_folder
from physic_core.errors import DownloadError
from physic_core.files.atomic import atomic_write, check_writable
from physic_core.weights.find import locate_files
from physic_core.weights.lock import locked
from physic_core.weights.manifest import HubSource, WebSource, WeightFile, WeightSet
from physic_core.weights.verify import describe_mismatch
from physic_setup.hub import download_from_hub
from physic_setup.pins import pin_files
from physic_setup.web import ByteProgress, download_from_web

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
        DownloadError: the licence is not accepted, a file has no source, or a download failed. Complete files are kept.
        OutputError: the folder cannot be written.
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
            f"'{weights.name}' is not downloaded without --accept-licence:\n{weights.describe_licence()}\n"
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
    folder = cache_folder("weights") if to is None else to
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
        if not in_hubs_cache:
            check_writable(target.parent)
        download_from_hub(file, None if in_hubs_cache else target, report, advice)
        return
    assert isinstance(origin, WebSource)
    if weights.account:
        advice = f"{weights.describe_licence().strip()}\n{_browser_instructions(target)}"
    check_writable(target.parent)
    if not origin.member:
        _download(origin.url, target, file, report, advice)
        return
    name = Path(origin.url.partition("?")[0]).name
    archive = folder / _ARCHIVES / (name if name.endswith(".zip") else f"{name}.zip")
    if not archive.is_file():
        check_writable(archive.parent)
        _download(origin.url, archive, WeightFile(archive.name), report, advice)
    _extract_member(archive, origin, file, target)


def _copy_if_valid(here: Path | None, file: WeightFile, target: Path) -> bool:
    """Copy a valid existing file to ``target``; return False if there is none."""
    if here is None or describe_mismatch(here, file):
        return False
    with atomic_write(check_writable(target.parent)) as temporary:
        shutil.copyfile(here, temporary(target.name))
    return True


def _browser_instructions(target: Path) -> str:
    return f"or download it with a browser to {target}"


def _download(url: str, target: Path, file: WeightFile, report: ByteProgress, advice: str) -> None:
    with atomic_write(target.parent) as temporary:
        part = temporary(target.name)
        download_from_web(url, part, file.bytes, report, advice)
        if wrong := describe_mismatch(part, file):
            raise DownloadError(f"{url} was downloaded, but {wrong}: removed{f'; {advice}' if advice else ''}")


def _extract_member(archive: Path, origin: WebSource, file: WeightFile, target: Path) -> None:
    """Extract one file of a zip archive to ``target``; names in the archive never determine the path."""
    try:
        with atomic_write(target.parent) as temporary:
            _extract(archive, origin, file, temporary(target.name))
    except DownloadError:  # the archive is invalid or has another version
        shutil.rmtree(archive.parent, ignore_errors=True)
        raise


def _extract(archive: Path, origin: WebSource, file: WeightFile, part: Path) -> None:
    try:
        with zipfile.ZipFile(archive) as opened:
            member = _find_member(opened, origin, file)
            with opened.open(member) as inside, part.open("wb") as out:
                shutil.copyfileobj(inside, out)
    except DownloadError:
        raise
    except Exception as error:  # of zipfile and its decompressors, which share no base class
        reason = ascii(str(error))[1:-1][:200]
        raise DownloadError(f"{origin.url} cannot be extracted ({reason}): removed") from error
    if wrong := describe_mismatch(part, file):
        raise DownloadError(f"{origin.url}#{origin.member} was extracted, but {wrong}: removed")


def _find_member(opened: zipfile.ZipFile, origin: WebSource, file: WeightFile) -> str:
    """Return the name of the member of a zip archive that the manifest names, with or without its folders.

    Raises:
        DownloadError: there is none, there are several, or it has another size.
    """
    names = [info.filename for info in opened.infolist() if not info.is_dir()]
    found = [origin.member] if origin.member in names else [n for n in names if n.endswith(f"/{origin.member}")]
    if not found:
        raise DownloadError(f"{origin.url} does not contain {origin.member}, only {_abbreviate(names)}")
    if len(found) > 1:
        raise DownloadError(
            f"{origin.url} contains several {origin.member}; the manifest should name one: {_abbreviate(found)}"
        )
    size = opened.getinfo(found[0]).file_size
    if file.bytes not in (None, size):
        raise DownloadError(f"{origin.url}#{origin.member} has {size} bytes instead of {file.bytes}: it has changed")
    return found[0]


def _abbreviate(names: list[str]) -> str:
    shown = [name if name.isprintable() else ascii(name)[1:-1] for name in names[:8]]
    return ", ".join(shown) + (", ..." if len(names) > 8 else "")
