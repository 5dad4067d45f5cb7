"""Download the missing files of a weight set with pooch and huggingface_hub, and verify their size
and SHA-256.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from physic_core.cache import cache_folder
from physic_core.errors import DownloadError
from physic_core.files import atomic_write, check_writable
from physic_core.weights import (
    HubSource,
    WebSource,
    WeightFile,
    WeightSet,
    common_folder,
    describe_mismatch,
    locate_files,
    size_mismatches,
)


def fetch(
    weights: WeightSet,
    *,
    accept: bool = False,
    to: Path | None = None,
    report: Callable[[WeightFile], None] = lambda file: None,
) -> tuple[str, ...]:
    """Download the missing files of a weight set.

    Args:
        weights: the set.
        accept: whether the user accepts a licence that restricts use or requires an account.
        to: folder for the complete set, as ``<to>/<set>/<file>``. None for the default: the cache
            of Hugging Face for files that come from there, else the user's cache folder.
        report: called before each download.

    Returns:
        Paths of the new files, relative to the set.

    Raises:
        DownloadError: the licence is not accepted, a file has no source, or a download failed.
            Complete files are kept.
        OutputError: the folder cannot be written.
    """
    base = to or cache_folder("weights")
    if base is None:
        raise DownloadError("there is no home folder for weights: choose a folder with --to")
    folder = base / weights.name
    if wrong := size_mismatches(weights):
        raise DownloadError(f"{wrong}: move those files away, and try again")
    absent = [file for file in weights.files if file.path not in _files_here(weights, to)]
    by_hand = ", ".join(file.path for file in absent if not file.source)
    advice = f"{weights.advice.rstrip('. ')}; then copy it into {folder}"
    if absent and not any(file.source for file in absent):
        raise DownloadError(f"{by_hand} of '{weights.name}' cannot be downloaded: {advice}")
    if absent and not (accept or weights.is_free):
        raise DownloadError(
            f"'{weights.name}' is not downloaded without "
            f"--accept-license:\n{weights.describe_licence()}\n"
            f"to accept the license: physic weights fetch {weights.name} --accept-license"
        )
    for file in absent:
        local_file = locate_files(weights).get(file.path)
        if local_file is not None and not describe_mismatch(local_file, file):
            _copy(local_file, folder / file.path)
        elif file.source:
            report(file)
            _fetch_file(weights, file, folder, in_folder=to is not None)
    if (
        not by_hand
        and to is None
        and len(weights.files) > 1
        and common_folder(_files_here(weights, None)) is None
    ):
        absent = [file for file in weights.files if not (folder / file.path).is_file()]
        for file in absent:
            _copy(_files_here(weights, None)[file.path], folder / file.path)
    if by_hand:
        raise DownloadError(f"{by_hand} of '{weights.name}' cannot be downloaded: {advice}")
    return tuple(file.path for file in absent)


def _files_here(weights: WeightSet, to: Path | None) -> dict[str, Path]:
    """Return the files of a set that are on this machine, or in the folder ``to``."""
    if to is None:
        return dict(locate_files(weights))
    inside = {file.path: to / weights.name / file.path for file in weights.files}
    return {path: place for path, place in inside.items() if place.is_file()}


def _fetch_file(weights: WeightSet, file: WeightFile, folder: Path, *, in_folder: bool) -> None:
    """Download a file to a folder, or into the cache of Hugging Face if it comes from there and
    need not be inside.
    """
    target = folder / file.path
    check_writable(target.parent)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".download-") as scratch:
        errors = []
        for source in (file.source, *weights.mirrors):
            try:
                downloaded = _download(file, source, Path(scratch))
                break
            except Exception as error:  # two libraries and their HTTP clients raise many classes
                errors.append((source, error))
        else:
            homepage = f"; see {weights.homepage}" if weights.homepage else ""
            tried = "\n".join(f"{source}: {error}" for source, error in errors)
            raise DownloadError(f"{tried}{homepage}") from errors[0][1]
        if wrong := describe_mismatch(downloaded, file):
            # the cache of Hugging Face has a file, and a link of its revision
            for path in {downloaded.resolve(), downloaded}:
                path.unlink()
            raise DownloadError(f"{source} was downloaded, but {wrong}: removed")
        if source == file.source and not isinstance(file.origin, HubSource):
            os.replace(downloaded, target)
        elif in_folder or source != file.source:
            _copy(downloaded, target)


def _copy(source: Path, target: Path) -> None:
    """Copy a file, which appears when it is complete."""
    with atomic_write(check_writable(target.parent)) as write:
        shutil.copyfile(source, write(target.name))


def _download(file: WeightFile, place: str, scratch: Path) -> Path:
    """Download a file from its source, or from a mirror: the repository "owner/name" on Hugging
    Face.
    """
    if place != file.source:
        return _download_from_hub(_find_in_mirror(file, place))
    return (
        _download_from_hub(file.origin)
        if isinstance(file.origin, HubSource)
        else _download_from_web(file, scratch)
    )


def _download_from_hub(origin: HubSource) -> Path:
    import huggingface_hub as hub

    return Path(hub.hf_hub_download(origin.repository, origin.path, revision=origin.revision))


def _find_in_mirror(file: WeightFile, repository: str) -> HubSource:
    """Return the file of a mirror that has the published SHA-256; for a small file the hub states
    only the size.
    """
    import huggingface_hub as hub

    listed = hub.HfApi().model_info(repository, files_metadata=True)
    for one in listed.siblings or ():
        if file.sha256 == one.lfs.sha256 if one.lfs else file.bytes == one.size:
            return HubSource(repository, one.rfilename, listed.sha or "main")
    raise DownloadError(f"no file there matches {file.path} by SHA-256 or size")


def _download_from_web(file: WeightFile, scratch: Path) -> Path:
    import pooch

    origin = file.origin
    assert isinstance(origin, WebSource)
    pooch.get_logger().setLevel("WARNING")
    # it strips the part of a name that leads out of the folder
    unzip = pooch.Unzip() if origin.member else None
    responses: list[Any] = []
    hooks = {"response": lambda response, **_: responses.append(response)}
    load = pooch.HTTPDownloader(progressbar=sys.stderr.isatty(), timeout=60, hooks=hooks)
    try:
        downloaded = pooch.retrieve(
            origin.url, None, "download", scratch, processor=unzip, downloader=load
        )
    finally:
        for response in responses:  # pooch does not close them
            response.close()
    if not origin.member:
        return Path(downloaded)
    members = [
        Path(path) for path in downloaded if Path(path).as_posix().endswith(f"/{origin.member}")
    ]
    if len(members) != 1:
        raise DownloadError(f"it contains {len(members)} files {origin.member} in place of one")
    return members[0]
