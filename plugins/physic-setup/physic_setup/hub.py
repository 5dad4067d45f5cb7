"""Download a file from a Hugging Face repository into the cache of ``huggingface_hub``.

The library resolves the file, the login and the mirror, and links the file into its cache. The file is downloaded by
:mod:`physic_setup.transfer`, which resumes an interrupted download; the library (2.x) starts again.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physic_core.errors import DownloadError
from physic_core.weights.locate import LOGIN
from physic_core.weights.manifest import HubSource, WeightFile
from physic_core.weights.verify import describe_mismatch, sha256_of
from physic_setup.transfer import ByteProgress, ResumableDownload, wrap_write_errors, write_error

__all__ = ["download_from_hub"]

_SHA256, _GIT = re.compile(r"[0-9a-f]{64}"), re.compile(r"[0-9a-f]{40}")


@dataclass(frozen=True)
class _RemoteFile:
    """Download address, ETag and size of a file in a repository."""

    url: str
    tag: str
    size: int | None


def download_from_hub(file: WeightFile, target: Path | None, report: ByteProgress, advice: str = "") -> Path:
    """Download a file from a Hugging Face repository.

    Args:
        file: a file with a source ``hf://...``.
        target: path to write to; None for the cache of Hugging Face.
        report: called with the bytes downloaded so far, and the total if known.
        advice: text for the error if the repository does not have the file.

    Returns:
        Path of the file.

    Raises:
        DownloadError: the download failed; the message states the cause and what to do.
    """
    import huggingface_hub as hub
    from huggingface_hub import constants
    from huggingface_hub.file_download import repo_folder_name
    from huggingface_hub.utils import build_hf_headers  # type: ignore[attr-defined]

    origin = file.origin
    assert isinstance(origin, HubSource)
    if _offline():
        raise DownloadError(
            f"{file.source}: HF_HUB_OFFLINE is set, so nothing is downloaded: unset it, or copy the file "
            "into a folder of PHYSIC_WEIGHTS"
        )
    remote = _request_metadata(origin, file, advice)
    if target is None:
        repository = Path(constants.HF_HUB_CACHE) / repo_folder_name(repo_id=origin.repository, repo_type="model")
        place = repository / "blobs" / remote.tag
    else:
        place = target
    if target is not None or not place.is_file():
        with wrap_write_errors(place):
            place.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_name(f"{place.name}.part")
        # The ETag identifies the version of the file, so a partial download with the same ETag can be resumed.
        transfer = ResumableDownload(
            part, remote.size, True, remote.tag, build_hf_headers(), _access_advice(origin), report
        )
        transfer.fetch(
            remote.url,
            place,
            lambda path: describe_mismatch(path, file) or _etag_mismatch(path, remote.tag),
            advice,
            file.source,
        )
    if target is not None:
        return target
    with _convert_errors(origin, advice):
        return Path(hub.hf_hub_download(origin.repository, origin.path, revision=origin.revision))


def _offline() -> bool:
    from huggingface_hub import constants

    return bool(constants.HF_HUB_OFFLINE)


def _request_metadata(origin: HubSource, file: WeightFile, advice: str) -> _RemoteFile:
    """Request the metadata of a file, and raise DownloadError if size or SHA-256 differ from the manifest."""
    from huggingface_hub import constants, get_hf_file_metadata, hf_hub_url

    url = hf_hub_url(origin.repository, origin.path, revision=origin.revision, endpoint=constants.ENDPOINT)
    with _convert_errors(origin, advice):
        found = get_hf_file_metadata(url)
    tag, size = found.etag, found.size
    if not tag or not found.commit_hash or "/" in tag:
        raise DownloadError(f"{constants.ENDPOINT} does not respond like the hub of Hugging Face: check HF_ENDPOINT")
    wrong = ""
    if file.bytes is not None and size not in (None, file.bytes):
        wrong = f"it has {size} bytes instead of {file.bytes}"
    elif file.sha256 is not None and _SHA256.fullmatch(tag) and tag != file.sha256:
        wrong = f"its SHA-256 is {tag} instead of {file.sha256}"
    if wrong:
        raise DownloadError(f"{file.source} has changed, {wrong}: not downloaded{f'; {advice}' if advice else ''}")
    return _RemoteFile(url, tag, size)


def _etag_mismatch(path: Path, tag: str) -> str:
    """Describe how the hash of a file differs from its ETag; "" if it matches."""
    if _SHA256.fullmatch(tag) and (found := sha256_of(path)) != tag:
        return f"its SHA-256 is {found} instead of {tag}"
    if _GIT.fullmatch(tag) and (found := _git_blob_hash(path)) != tag:
        return f"its git hash is {found} instead of {tag}"
    return ""


def _git_blob_hash(path: Path) -> str:
    """Return the git blob hash of a file; Hugging Face uses it as ETag of small files."""
    digest = hashlib.sha1(f"blob {path.stat().st_size}\0".encode(), usedforsecurity=False)
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: digest).hexdigest()


def _access_advice(origin: HubSource) -> str:
    from huggingface_hub import constants

    return f"accept its terms at {constants.ENDPOINT}/{origin.repository}, {LOGIN}, and try again"


@contextmanager
def _convert_errors(origin: HubSource, advice: str) -> Iterator[None]:
    """Convert errors of the library to a DownloadError with advice."""
    from huggingface_hub import constants, errors

    name = f"hf://{origin.repository}"
    suffix = f"; {advice}" if advice else ""
    try:
        yield
    except DownloadError:
        raise
    except errors.GatedRepoError as error:
        raise DownloadError(f"{name} is gated, and your login has no access to it: {_access_advice(origin)}") from error
    except errors.RepositoryNotFoundError as error:
        raise DownloadError(
            f"{name} does not exist, or you have no access (HTTP {_code(error)}): if it is private or gated, "
            f"{_access_advice(origin)}{suffix}"
        ) from error
    except errors.RevisionNotFoundError as error:
        raise DownloadError(f"{name} has no revision {origin.revision}{suffix}") from error
    except errors.EntryNotFoundError as error:
        where = "" if origin.revision == "main" else f" at revision {origin.revision}"
        raise DownloadError(f"{name} has no file {origin.path}{where} (HTTP 404){suffix}") from error
    except errors.HfHubHTTPError as error:
        code = _code(error)
        if code in (401, 403):
            raise DownloadError(f"{name} refuses access (HTTP {code}): {_access_advice(origin)}") from error
        raise DownloadError(f"{name} is not available now (HTTP {code}): try again later") from error
    except errors.FileMetadataError as error:
        raise DownloadError(
            f"{constants.ENDPOINT} does not respond like the hub of Hugging Face: check HF_ENDPOINT"
        ) from error
    except OSError as error:
        if error.filename is None:
            raise DownloadError(_unreachable(name, error)) from error
        raise write_error(Path(constants.HF_HUB_CACHE), error) from error
    except Exception as error:  # the HTTP library, and so its errors, depend on the version
        raise DownloadError(_unreachable(name, error)) from error


def _unreachable(name: str, error: Exception) -> str:
    from huggingface_hub import constants

    return f"{name}: {constants.ENDPOINT} cannot be reached ({type(error).__name__}): check the network connection"


def _code(error: Any) -> int:
    return int(getattr(getattr(error, "response", None), "status_code", 0) or 0)
