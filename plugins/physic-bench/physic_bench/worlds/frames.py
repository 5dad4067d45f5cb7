"""Worlds as a data set, and the engine's result of each row of the table for them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.cameras import Camera
from physic_bench.contract import BenchPerson, Frame, Truth
from physic_bench.datasets.base import FrameSet
from physic_bench.readers import prediction_of
from physic_core.batch.workers import started_processes
from physic_core.body.joints import JOINT_NAMES
from physic_core.errors import PhysicError
from physic_core.files.atomic import atomic_write, check_writable
from physic_testing.worlds import load_world

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from physic_bench.worlds.ablation import TableRow
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.engine.state import Estimates
    from physic_testing.worlds import World

    Array = NDArray[np.float64]

LIKELY_CONTACT = 0.5
"""Probability of the contact prior from which on a vertex of the estimators' bodies touches."""


@dataclass(frozen=True)
class BenchmarkJob:
    """What is computed for each world.

    Attributes:
        config: of the backends with their noise, and of the engine settings that they read.
        rows: of the table.
        folder: of the results; those that are there stay.
    """

    config: Config
    rows: tuple[TableRow, ...]
    folder: Path

    def results(self, row: TableRow) -> Path:
        """Return the folder of the results of a row, which has the hash of all that changes
        them.
        """
        digest = hashlib.sha256(self.config.model_dump_json().encode())
        digest.update(f"{row.digest} {_source_hash()}".encode())
        return self.folder / f"{row.key}-{digest.hexdigest()[:16]}"


def world_frames(names: Sequence[str]) -> FrameSet:
    """Return the worlds as frames; each is a sequence of its own."""
    return FrameSet(tuple(_frame(name) for name in names))


def _frame(name: str) -> Frame:
    camera = load_world(name).intrinsics
    return Frame(
        name,
        name,
        partial(_truth, name),
        Camera(camera.matrix.astype(np.float64), camera.width, camera.height),
    )


def _truth(name: str) -> Truth:
    world = load_world(name)
    people = tuple(
        BenchPerson(
            name=str(i),
            joints=world.joints[i],
            joint_names=JOINT_NAMES,
            joint_source="of the world",
            vertices=world.vertices[i],
            topology=world.topology,
            contact=world.contact[i],
            contact_topology=world.topology,
        )
        for i in range(len(world.masks))
    )
    return Truth(people, _distances(world), world.floor.normal, world.floor.offset)


def _distances(world: World) -> Callable[[Array], Array]:
    """Return the signed distance of points (N, 3) to the scene that the photo would show without
    people; 0 for points inside that the scene hides.
    """
    from physic_core.metrics import hidden_by_depth_map, scene_distance

    empty = world.points(people=False)
    known = np.asarray(np.isfinite(empty).all(-1))

    def distance(points: Array) -> Array:
        normals = world.empty_normals
        near = scene_distance(points[None], empty, normals, known, world.intrinsics, world.floor)
        hidden = hidden_by_depth_map(points, world.empty_depth, world.intrinsics)
        found = near.distance[0]
        return np.where(hidden & (found < 0), 0.0, found)

    return distance


def solve_worlds(
    names: Sequence[str], work: BenchmarkJob, jobs: int = 1
) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Write the results of all rows for worlds, as the reader "plain" reads them; yield each world
    with row key -> why there is no result, in order of completion.

    Raises:
        PhysicError: a process was killed.
    """
    if jobs == 1:
        yield from ((name, solve_world(name, work)) for name in names)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        try:
            with started_processes():
                futures = {pool.submit(solve_world, name, work): name for name in names}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool as error:
            raise PhysicError(
                "a process of the benchmark was ended from outside, as happens where memory runs "
                "out; what is done is kept: go on with fewer --jobs"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def solve_world(name: str, work: BenchmarkJob) -> dict[str, str]:
    """Run the estimators once on a world, and the engine for each row without a result; return
    row key -> why there is none.
    """
    from physic_core.adapters.devices import limited_threads
    from physic_core.body import load_body
    from physic_core.configuration.resolve import resolve
    from physic_core.pipeline.estimate import run_backends
    from physic_core.pipeline.optimise import run_engine
    from physic_core.pipeline.stage_runner import StageRunner

    todo = [row for row in work.rows if not (work.results(row) / f"{name}.npz").is_file()]
    if not todo:
        return {}
    plan = resolve(work.config)
    model = load_body(plan.body_model)
    frame = _frame(name)
    stages = StageRunner(plan.device, len(plan.backends))
    failures = {}
    with limited_threads(work.config.run.threads):
        try:
            evidence = run_backends(load_world(name).image, None, plan, lambda: model, stages)
        except Exception as error:  # of any backend: it is a failure of this world, and is counted
            return dict.fromkeys((row.key for row in todo), f"{type(error).__name__}: {error}")
        for row in todo:
            try:
                if row.settings is None:
                    arrays = _start(evidence, model)
                else:
                    result = run_engine(evidence, row.settings, model, stages)
                    found = prediction_of(result, frame)
                    arrays = {"K": found.K, "floor": found.floor}
                    for part in ("vertices", "joints", "contact"):
                        arrays[part] = np.array([getattr(one, part) for one in found.people])
            except Exception as error:  # one row that fails in one world ends nothing
                failures[row.key] = f"{type(error).__name__}: {error}"
                continue
            known = {key: value for key, value in arrays.items() if value is not None}
            with atomic_write(check_writable(work.results(row))) as temporary:
                path = temporary(f"{name}.npz")
                with path.open("wb") as file:
                    np.savez(file, joint_names=np.array(JOINT_NAMES), **known)
    return failures


def _start(evidence: Estimates, model: BodyModel) -> dict[str, Any]:
    """Return the estimators' bodies, with contact where the prior is likely."""
    import torch

    from physic_core.body.bones import rotations_from_parameters
    from physic_core.geometry.tensors import tensor

    given = evidence.bodies.parameters
    parts = (
        tensor(part).to(model.device, model.dtype)
        for part in (given.betas, given.transl, given.expression)
    )
    with torch.inference_mode():
        body = model(rotations_from_parameters(given, model.device, model.dtype), *parts)
    finite = torch.isfinite(body.vertices).flatten(1).all(1).cpu().numpy()
    return {
        "vertices": body.vertices.cpu().numpy()[finite],
        "joints": body.joints.cpu().numpy()[finite],
        "contact": evidence.contact.probability[finite] >= LIKELY_CONTACT,
        "K": evidence.intrinsics.matrix,
    }


@cache
def _source_hash() -> str:
    """Return a hash of the source and data of core, worlds, mocks and benchmark."""
    digest = hashlib.sha256()
    for package in ("physic_core", "physic_testing", "physic_mock", "physic_bench"):
        spec = find_spec(package)
        for place in (spec.submodule_search_locations or ()) if spec is not None else ():
            for file in sorted(Path(place).rglob("*")):
                if file.suffix in (".py", ".json", ".npz"):
                    digest.update(file.relative_to(place).as_posix().encode())
                    digest.update(file.read_bytes())
    return digest.hexdigest()
