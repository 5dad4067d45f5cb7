"""Download a file from a Hugging Face repository with ``huggingface_hub``."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from physic_core.errors import DownloadError
from physic_core.files.atomic import atomic_write
from physic_core.weights.manifest import LOGIN, HubSource, WeightFile
from physic_core.weights.verify import describe_mismatch
from physic_setup.web import ByteProgress


def download_from_hub(file: WeightFile, target: Path | None, report: ByteProgress, advice: str = "") -> None:
    """Download a file from a Hugging Face repository, and compare it with the manifest.

    Args:
        file: a file with a source ``hf://...``.
        target: path to write to, in a folder that exists; None for the cache of Hugging Face.
        report: called with the bytes downloaded so far, and the total if known.
        advice: text for the error if the repository does not have the file, or has another one.

    Raises:
        DownloadError: the download failed, or the file differs, and is removed.
        OutputError: the folder of the target cannot be written.
    """
    if target is None:
        found = _download(file, None, report, advice)
        if wrong := describe_mismatch(found, file):
            for path in {found.resolve(), found}:  # the file, and the link of its revision
                path.unlink()
            raise _mismatch(file, wrong, advice)
        return
    with (
        atomic_write(target.parent) as temporary,
        tempfile.TemporaryDirectory(dir=target.parent, prefix=".hub-") as folder,
    ):
        found = _download(file, folder, report, advice)
        if wrong := describe_mismatch(found, file):
            raise _mismatch(file, wrong, advice)
        os.replace(found, temporary(target.name))


def _download(file: WeightFile, folder: str | None, report: ByteProgress, advice: str) -> Path:
    import huggingface_hub as hub
    from huggingface_hub import constants
    from huggingface_hub.utils import tqdm  # type: ignore[attr-defined]

    class Report(tqdm):
        """Calls the callback in place of drawing a bar."""

        def __init__(self, *arguments: Any, **settings: Any) -> None:
            super().__init__(*arguments, **settings | {"disable": True})  # type: ignore[no-untyped-call]

        def update(self, n: float | None = 1) -> None:
            self.n += n
            report(int(self.n), self.total)

    if constants.HF_HUB_OFFLINE:
        raise DownloadError(
            f"{file.source}: HF_HUB_OFFLINE is set, so nothing is downloaded: unset it, or copy the file "
            "into a folder of PHYSIC_WEIGHTS"
        )
    origin = file.origin
    assert isinstance(origin, HubSource)
    try:
        return Path(
            hub.hf_hub_download(
                origin.repository, origin.path, revision=origin.revision, local_dir=folder, tqdm_class=Report
            )
        )
    except Exception as error:  # the HTTP library, and so its errors, depend on the version
        raise DownloadError(_cause(error, origin, f"; {advice}" if advice else "")) from error


def _mismatch(file: WeightFile, wrong: str, advice: str) -> DownloadError:
    return DownloadError(f"{file.source} was downloaded, but {wrong}: removed{f'; {advice}' if advice else ''}")


def _cause(error: BaseException, origin: HubSource, end: str) -> str:
    """Return what an error of the library means, and what to do."""
    from huggingface_hub import constants, errors

    name = f"hf://{origin.repository}"
    access = f"accept its terms at {constants.ENDPOINT}/{origin.repository}, {LOGIN}, and try again"
    if isinstance(error, errors.LocalEntryNotFoundError) and error.__cause__ is not None:
        error = error.__cause__  # it says that there is no file in the cache either
    code = int(getattr(getattr(error, "response", None), "status_code", 0) or 0)
    if isinstance(error, errors.GatedRepoError):
        return f"{name} is gated, and your login has no access to it: {access}"
    if isinstance(error, errors.RepositoryNotFoundError):
        return f"{name} does not exist, or you have no access (HTTP {code}): if it is private or gated, {access}{end}"
    if isinstance(error, errors.RevisionNotFoundError):
        return f"{name} has no revision {origin.revision}{end}"
    if isinstance(error, errors.EntryNotFoundError):
        where = "" if origin.revision == "main" else f" at revision {origin.revision}"
        return f"{name} has no file {origin.path}{where} (HTTP 404){end}"
    if isinstance(error, errors.FileMetadataError):
        return f"{constants.ENDPOINT} does not respond like the hub of Hugging Face: check HF_ENDPOINT"
    if code in (401, 403):
        return f"{name} refuses access (HTTP {code}): {access}"
    if code:
        return f"{name} is not available now (HTTP {code}): try again later"
    if isinstance(error, OSError) and error.errno is not None:
        return f"{name} cannot be written ({error.strerror}): choose another folder with --to or HF_HOME"
    return (
        f"{name}: {constants.ENDPOINT} cannot be reached, or the connection was lost ({type(error).__name__}): check "
        "the network connection, and try again"
    )
