"""One world through the estimators: the evidence that every row of the table starts from."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import physic_core
from physic_core.pipeline.estimate import run_backends
from physic_core.pipeline.stage_runner import StageRunner
from physic_testing.bench.evidence_io import load_evidence, save_evidence

if TYPE_CHECKING:
    from collections.abc import Iterable

    from physic_core.body.model import BodyModel
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.pipeline.estimate import Estimates
    from physic_testing.worlds import World

__all__ = ["Case", "cache_folder", "chosen_cases", "evidence_key", "look", "source_hash"]


@dataclass(frozen=True)
class Case:
    """A world by its name.

    Attributes:
        name: one of ``physic_testing.worlds.WORLDS``.
        seed: of the world.
        size: width and height of the photo, px.
    """

    name: str
    seed: int
    size: tuple[int, int]

    @property
    def title(self) -> str:
        """For messages: "lie 7"."""
        return f"{self.name} {self.seed}"


def look(case: Case, world: World, plan: ResolvedPipeline, model: BodyModel, folder: Path | None) -> Estimates:
    """What the estimators say of the world's photo; read from ``folder`` where it lies there already.

    The camera is not given: what the estimators take it for is part of the start.

    Raises:
        PhysicError: nobody was found, or a backend failed.
    """
    path = None if folder is None else folder / f"{evidence_key(case, plan)}.npz"
    known = None if path is None else load_evidence(path)
    if known is not None:
        return known
    evidence = run_backends(world.image, None, plan, model, StageRunner(plan.device, len(plan.backends)))
    if path is not None:
        save_evidence(path, evidence)
    return evidence


def evidence_key(case: Case, plan: ResolvedPipeline) -> str:
    """Names the evidence: of this world, these backends with these options, and the code that makes both."""
    facts = {
        "world": [case.name, case.seed, *case.size],
        "photo": plan.photo.model_dump(mode="json"),
        "backends": {
            name: [
                found.provenance.backend,
                found.provenance.distribution,
                found.provenance.version,
                found.provenance.options,
            ]
            for name, found in plan.backends.items()
        },
        "source": [
            source_hash(("physic_core/body", "physic_core/pipeline/estimate.py", "physic_core/pipeline/validation.py")),
            _folder_hash("physic_testing"),
            *sorted({_folder_hash(found.provenance.plugin) for found in plan.backends.values()}),
        ],
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:24]


@cache
def source_hash(parts: tuple[str, ...] = ("physic_core", "physic_testing")) -> str:
    """Hash of modules: packages, or folders and files in them, such as "physic_core/body"."""
    root = {"physic_core": Path(physic_core.__file__).parents[1], "physic_testing": Path(__file__).parents[2]}
    digest = hashlib.sha256()
    for part in parts:
        top = root[part.partition("/")[0]]
        digest.update(_hash(top, _modules(top / part)).encode())
    return digest.hexdigest()


@cache
def _folder_hash(package: str) -> str:
    from importlib.util import find_spec

    spec = find_spec(package.partition(".")[0])
    places = list(spec.submodule_search_locations or []) if spec is not None else []
    return _hash(Path(places[0]), _modules(Path(places[0]))) if places else package


def _modules(path: Path) -> Iterable[Path]:
    return [path] if path.is_file() else sorted(path.rglob("*.py"))


def _hash(root: Path, paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where evidence is kept between runs: ``physic/bench`` in the user's cache folder."""
    import os

    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "physic" / "bench"


def chosen_cases(count: int, seed: int, size: tuple[int, int]) -> tuple[Case, ...]:
    """The benchmark's worlds of a seed.

    Args:
        count: how many; each action comes equally often.
        seed: draws the worlds.
        size: width and height of the photos, px.
    """
    from physic_testing.worlds import benchmark_worlds

    return tuple(Case(name, number, size) for name, number in benchmark_worlds(count, seed))
