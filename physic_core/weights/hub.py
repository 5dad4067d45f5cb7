"""Download a file from a Hugging Face repository into the cache of ``huggingface_hub``.

The library resolves the file, the login and the mirror, and links the file into its cache. The bytes are downloaded by
:mod:`physic_core.weights.transfer`, because the library (2.x) discards a partial download when it is interrupted. Ours
resumes it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physic_core.errors import DownloadError
from physic_core.weights.manifest import HubSource, WeightFile
from physic_core.weights.transfer import Tell, Transfer, unwritable, writing
from physic_core.weights.verify import difference, git_hash, sha256_of

__all__ = ["LOGIN", "from_hub"]

LOGIN = "log in with `hf auth login`, or set HF_TOKEN"
_SHA256, _GIT = re.compile(r"[0-9a-f]{64}"), re.compile(r"[0-9a-f]{40}")


@dataclass(frozen=True)
class _Remote:
    """Metadata of a file in a repository."""

    url: str
    tag: str
    size: int | None


def from_hub(file: WeightFile, target: Path | None, tell: Tell, advice: str = "") -> Path:
    """Download a file from a Hugging Face repository.

    Args:
        file: a file with a source ``hf://...``.
        target: path to write to; None for the library's own cache.
        tell: progress callback: bytes downloaded so far, and the total if known.
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
            f"{file.source}: HF_HUB_OFFLINE is set, so nothing is fetched: unset it, or bring the file in a folder of "
            "PHYSIC_WEIGHTS"
        )
    remote = _ask(origin, file, advice)
    if target is None:
        repository = Path(constants.HF_HUB_CACHE) / repo_folder_name(repo_id=origin.repository, repo_type="model")
        place = repository / "blobs" / remote.tag
    else:
        place = target
    if target is not None or not place.is_file():
        with writing(place):
            place.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_name(f"{place.name}.part")
        # The tag is the hash of the content, or names the version at the least: what was begun under it can go on.
        transfer = Transfer(part, remote.size, True, remote.tag, build_hf_headers(), _access(origin), tell)
        transfer.bring(remote.url)
        if wrong := difference(part, file) or _unlike_tag(part, remote.tag):
            transfer.forget()
            raise DownloadError(f"{file.source} came, but {wrong}: removed{f'; {advice}' if advice else ''}")
        transfer.place(place)
    if target is not None:
        return target
    with _in_words(origin, advice):
        return Path(hub.hf_hub_download(origin.repository, origin.path, revision=origin.revision))


def _offline() -> bool:
    from huggingface_hub import constants

    return bool(constants.HF_HUB_OFFLINE)


def _ask(origin: HubSource, file: WeightFile, advice: str) -> _Remote:
    """Request the metadata of a file; raise an error if it differs from the manifest."""
    from huggingface_hub import constants, get_hf_file_metadata, hf_hub_url

    url = hf_hub_url(origin.repository, origin.path, revision=origin.revision, endpoint=constants.ENDPOINT)
    with _in_words(origin, advice):
        found = get_hf_file_metadata(url)
    tag, size = found.etag, found.size
    if not tag or not found.commit_hash or "/" in tag:
        raise DownloadError(f"{constants.ENDPOINT} answers, but not as Hugging Face's hub does: look at HF_ENDPOINT")
    wrong = ""
    if file.bytes is not None and size not in (None, file.bytes):
        wrong = f"it has {size} bytes instead of {file.bytes}"
    elif file.sha256 is not None and _SHA256.fullmatch(tag) and tag != file.sha256:
        wrong = f"its SHA-256 is {tag} instead of {file.sha256}"
    if wrong:
        raise DownloadError(
            f"{file.source} is another file by now, {wrong}: not fetched{f'; {advice}' if advice else ''}"
        )
    return _Remote(url, tag, size)


def _unlike_tag(path: Path, tag: str) -> str:
    """Describe how a file differs from its ETag, which is a hash of its content; "" if it matches."""
    if _SHA256.fullmatch(tag) and (found := sha256_of(path)) != tag:
        return f"its SHA-256 is {found} instead of {tag}"
    if _GIT.fullmatch(tag) and (found := git_hash(path)) != tag:
        return f"its git hash is {found} instead of {tag}"
    return ""


def _access(origin: HubSource) -> str:
    from huggingface_hub import constants

    return f"accept its terms at {constants.ENDPOINT}/{origin.repository}, {LOGIN}, and fetch again"


@contextmanager
def _in_words(origin: HubSource, advice: str) -> Iterator[None]:
    """Convert errors of the library to DownloadError with advice."""
    from huggingface_hub import constants, errors

    name = f"hf://{origin.repository}"
    then = f"; {advice}" if advice else ""
    try:
        yield
    except DownloadError:
        raise
    except errors.GatedRepoError as error:
        raise DownloadError(f"{name} is gated, and your login has no access to it: {_access(origin)}") from error
    except errors.RepositoryNotFoundError as error:
        raise DownloadError(
            f"{name} is not there, or not for you (HTTP {_code(error)}): if it is private or gated, {_access(origin)}"
            f"{then}"
        ) from error
    except errors.RevisionNotFoundError as error:
        raise DownloadError(f"{name} has no revision {origin.revision} any more{then}") from error
    except errors.EntryNotFoundError as error:
        where = "" if origin.revision == "main" else f" at revision {origin.revision}"
        raise DownloadError(f"{name} has no file {origin.path}{where} (HTTP 404){then}") from error
    except errors.HfHubHTTPError as error:
        code = _code(error)
        if code in (401, 403):
            raise DownloadError(f"{name} is not given to you (HTTP {code}): {_access(origin)}") from error
        raise DownloadError(f"{name} cannot be had now (HTTP {code}): try again later") from error
    except errors.FileMetadataError as error:
        raise DownloadError(
            f"{constants.ENDPOINT} answers, but not as Hugging Face's hub does: look at HF_ENDPOINT"
        ) from error
    except OSError as error:
        if error.filename is None:
            raise DownloadError(_unreachable(name, error)) from error
        raise unwritable(Path(constants.HF_HUB_CACHE), error) from error
    except Exception as error:  # each version of the library talks through another one, which has errors of its own
        raise DownloadError(_unreachable(name, error)) from error


def _unreachable(name: str, error: Exception) -> str:
    from huggingface_hub import constants

    return f"{name}: {constants.ENDPOINT} cannot be reached ({type(error).__name__}): is the network on?"


def _code(error: Any) -> int:
    return int(getattr(getattr(error, "response", None), "status_code", 0) or 0)
