"""Estimates of a world: the output of all estimators for its photo, computed once and cached."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.engine.carriers import Carried
from physic_core.engine.sizes.evidence import MeasuredScale
from physic_core.engine.stance import Stance
from physic_core.engine.state import Estimates, OtherView
from physic_core.files.plain import DamagedFileError, read_value, write_value
from physic_core.geometry.floor import FloorSearch
from physic_core.pipeline.estimate import run_backends
from physic_core.pipeline.stage_runner import StageRunner

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_testing.worlds import World

_ESTIMATION_CODE = (
    "physic_core/body",
    "physic_core/pipeline/known_people.py",
    "physic_core/pipeline/estimate.py",
    "physic_testing",
)
"""Source files on which evidence depends, besides the plugins of the backends."""


def noisy_config() -> Config:
    """Return the mocks with errors as large as on photos, and labelled surfaces."""
    from physic_core.configuration.model import load_config
    from physic_core.interfaces import INTERFACES

    noise = [f"{name}.options.noise=1" for name in INTERFACES]
    return load_config(preset="mock", overrides=[*noise, "segmenter.options.surfaces=true"])


def estimate_evidence(
    world: World, plan: ResolvedPipeline, model: BodyModel, folder: Path | None
) -> Estimates:
    """Run the estimators on a world's photo, or load their output from ``folder``.

    The camera is not given: what the estimators take it for is part of the start.

    Raises:
        PhysicError: no person was found, or a backend failed.
    """
    path = None if folder is None else folder / f"{evidence_key(world.name, plan)}.npz"
    known = None if path is None else load_evidence(path)
    if known is not None:
        return known
    evidence = run_backends(
        world.image, None, plan, lambda: model, StageRunner(plan.device, len(plan.backends))
    )
    if path is not None:
        write_value(path, evidence)
    return evidence


def load_evidence(path: Path) -> Estimates | None:
    """Read evidence from a file; None if it is missing or damaged."""
    with suppress(OSError, DamagedFileError):
        found: Estimates = read_value(
            path, [Estimates, OtherView, FloorSearch, Stance, Carried, MeasuredScale]
        )
        return found
    return None


def evidence_key(world: str, plan: ResolvedPipeline) -> str:
    """Return the cache key of a world's evidence: a hash of world, backends, options and source
    code.
    """
    plugins = {found.provenance.plugin.partition(".")[0] for found in plan.backends.values()}
    facts = {
        "world": world,
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
        "source": source_hash(*_ESTIMATION_CODE, *sorted(plugins)),
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:24]


@cache
def source_hash(*parts: str) -> str:
    """Return a hash of Python files, and of data files with fitted numbers.

    Args:
        parts: installed packages, or folders or modules in them, such as "physic_core/body". Of a
            package that is not installed, the name counts.
    """
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode())
        spec = find_spec(part.partition("/")[0])
        for place in (spec.submodule_search_locations or ()) if spec is not None else ():
            root = Path(place).parent
            path = root / part
            found = (
                [path]
                if path.is_file()
                else (one for one in path.rglob("*") if one.suffix in (".py", ".json", ".npz"))
            )
            for file in sorted(found):
                digest.update(file.relative_to(root).as_posix().encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
