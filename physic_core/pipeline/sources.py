"""The weight files and repositories of a run, and warnings about those that differ from the pinned ones."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from physic_core.interfaces import Repository
from physic_core.weights.lock import FileUse, lock_file_path, read_lock

if TYPE_CHECKING:
    from physic_core.configuration.resolve import ResolvedPipeline


def describe_sources(plan: ResolvedPipeline, files: Mapping[str, FileUse]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the entries "weights" and "repositories" of the diagnostics, and warnings.

    A repository's state is "tested" or "locked" if it is at the commit with which the backend was tested, or that of
    the lock file, "differs" if it is at another one, and "unpinned" if there is no such commit.

    Args:
        plan: the backends of the run.
        files: weight files that were loaded, by "set/file".
    """
    repositories: dict[str, FileUse] = {}
    for resolved in plan.backends.values():
        with suppress(Exception):  # of a plugin; the result is complete without its statement
            for one in resolved.backend.requirements():
                if isinstance(one, Repository) and one.found:
                    repositories[one.url] = {"commit": one.found, "state": _state(one)}
    entries = {"weights": dict(sorted(files.items())), "repositories": repositories}
    others = [f"weights {name} are not those of {lock_file_path()}" for name, use in files.items() if _differs(use)]
    others += [
        f"the checkout of {url} is at {use['commit'][:7]}, not at the commit that was pinned"
        for url, use in repositories.items()
        if _differs(use)
    ]
    return {name: entry for name, entry in entries.items() if entry}, tuple(others)


def _differs(use: FileUse) -> bool:
    return use["state"] == "differs"


def _state(one: Repository) -> str:
    if one.commit:
        return "tested" if one.found.startswith(one.commit) else "differs"
    expected = read_lock().get(one.url, {}).get("commit")
    return "unpinned" if expected is None else "locked" if expected == one.found else "differs"
