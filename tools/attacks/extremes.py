"""Run every setting at its least and at its greatest value: ``python tools/attacks/extremes.py [--minutes 10]``.

A run ends within five minutes, with a result that is finite and can be saved and loaded, or with an error of PhySIC.
Settings are those of the engine in each preset, of photo and run, and the options of the mock and embedded backends.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import multiprocessing
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from pydantic import BaseModel

from physic_core import Pipeline, Reconstruction, engine_preset_names
from physic_core.configuration.model import PhotoSettings, RunSettings, load_config, stage_models
from physic_core.discovery.plugins import discover
from physic_core.errors import PhysicError
from physic_testing.worlds import build_world

LIMIT_S = 300
DISTRIBUTIONS = {"physic-mock": "mock", "physic-embedded": "light-cpu"}
"""Distribution of the options, and the preset that they are run with."""

Case = dict[str, Any]
"""The preset, and the tables that are laid over it."""


def cases() -> list[Case]:
    """Return two cases for each numeric setting, in the order of the settings."""
    found: list[Case] = []
    for preset in engine_preset_names():
        for stage, model in stage_models(preset).items():
            if preset == "default" or stage == "joint":
                for path, value in extremes(model):
                    found.append(case("mock", "engine", stage, *path, value=value, engine=preset))
    for table, model in (("photo", PhotoSettings), ("run", RunSettings)):
        found += [case("mock", table, *path, value=value) for path, value in extremes(model)]
    registry = discover()
    for offer in registry:
        preset = DISTRIBUTIONS.get(offer.origin.distribution, "")
        if preset and offer.record.name in ("mock", "embedded"):
            record = offer.record
            for path, value in extremes(registry.load_class(offer).Options):
                found.append(case(preset, record.interface, "options", *path, value=value, backend=record.name))
    return found


def case(preset: str, *path: str, value: Any, engine: str = "default", backend: str = "") -> Case:
    tables: Any = value
    for key in reversed(path):
        tables = {key: tables}
    # Few steps, since there are hundreds of runs.
    fewer = {"optimiser": {"steps": 3}}
    joint = merge({"joint": fewer}, tables.get("engine", {}))
    tables["engine"] = {"preset": engine, **joint}
    if backend:
        tables[path[0]]["backend"] = backend
    return {"preset": preset, "name": f"{engine} {'.'.join(path)} = {value}", "tables": tables}


def merge(below: Any, above: Any) -> Any:
    if not isinstance(below, dict) or not isinstance(above, dict):
        return above
    return below | {key: merge(below.get(key, {}), value) for key, value in above.items()}


def extremes(model: type[BaseModel]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the path of each numeric setting of a model, with its least and with its greatest value."""
    schema = model.model_json_schema()
    for name, field in schema["properties"].items():
        yield from _extremes(field, schema.get("$defs", {}), (name,))


def _extremes(field: Any, parts: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    if "$ref" in field:
        field = parts[field["$ref"].rpartition("/")[2]]
    for alternative in field.get("anyOf", []):
        yield from _extremes(alternative, parts, path)
    if field.get("type") == "object":
        for name, inner in field.get("properties", {}).items():
            yield from _extremes(inner, parts, (*path, name))
    elif "enum" not in field and "const" not in field and field.get("type") in ("integer", "number", "array"):
        for greatest in (False, True):
            yield path, extreme(field, greatest)


def extreme(field: Any, greatest: bool) -> Any:
    """Return the least or the greatest value that a JSON Schema allows; of a list, the shortest or the longest one."""
    if "enum" in field:
        return field["enum"][-1 if greatest else 0]
    if field["type"] == "array":
        if "prefixItems" in field:
            return [extreme(item, greatest) for item in field["prefixItems"]]
        count = field["maxItems"] if greatest else field.get("minItems", 0)
        return [extreme(field["items"], greatest)] * count
    if greatest and "multipleOf" in field:
        return field["maximum"] // field["multipleOf"] * field["multipleOf"]
    if greatest:
        return field.get("maximum", math.inf) if "exclusiveMaximum" not in field else below(field["exclusiveMaximum"])
    return field["minimum"] if "minimum" in field else -below(-field["exclusiveMinimum"])


def below(bound: float) -> float:
    return math.nextafter(bound, -math.inf)


@cache
def photo() -> Any:
    return build_world("stand").image


def run_case(given: Case, folder: Path) -> str:
    """Run a case, and return the first line of its error, or an empty text; raise what must not happen."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = folder / "photo.png"
        Image.fromarray(photo()).save(file)
        try:
            config = load_config(preset=given["preset"], flags={"case": given["tables"]}, environment={})
            with Pipeline(config) as pipeline:
                result = pipeline(file)
        except PhysicError as error:
            return str(error).partition("\n")[0]
        for person in result.people:
            assert np.isfinite(person.vertices).all(), "vertices are not finite"
            assert np.isfinite(person.joints).all(), "joints are not finite"
        result.save(folder / "out")
        assert len(Reconstruction.load(folder / "out").people) == len(result.people)
    return ""


def work(connection: Connection) -> None:
    for given in iter(connection.recv, None):
        with tempfile.TemporaryDirectory() as folder:
            try:
                connection.send(("ended", run_case(given, Path(folder))))
            except BaseException:
                connection.send(("failed", traceback.format_exc()))


class Worker:
    """A process that runs cases, and is replaced when a case takes too long or ends it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other = context.Pipe()
        self.process = context.Process(target=work, args=(other,), daemon=True)
        self.process.start()
        other.close()

    def run(self, given: Case) -> tuple[str, str]:
        self.connection.send(given)
        try:
            if self.connection.poll(LIMIT_S):
                answer: tuple[str, str] = self.connection.recv()
                return answer
            return "failed", f"no answer within {LIMIT_S} s"
        except EOFError:
            return "failed", f"the process ended with {self.process.exitcode}"

    def close(self) -> None:
        self.process.kill()
        self.process.join()


def main() -> int:
    """Run all cases in random order while there is time; return 1 if one failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings/extremes"))
    parser.add_argument("--only", default="", help="cases whose name contains this text")
    parser.add_argument(
        "--seed", type=int, default=time.time_ns(), help="of the order of the cases; else another each time"
    )
    given = parser.parse_args()
    chosen = [one for one in cases() if given.only in one["name"]]
    random.Random(given.seed).shuffle(chosen)
    end, ran, failed, worker = time.monotonic() + 60 * given.minutes, 0, 0, Worker()
    for one in itertools.takewhile(lambda _: time.monotonic() < end, chosen):
        kind, text = worker.run(one)
        ran += 1
        if kind == "failed":
            failed += 1
            given.keep.mkdir(parents=True, exist_ok=True)
            (given.keep / f"{ran}.txt").write_text(f"{one['name']}\n{json.dumps(one)}\n{text}\n")
            print(f"FAILED {one['name']}: {text.strip().splitlines()[-1]}", flush=True)
            worker.close()
            worker = Worker()
    worker.close()
    print(f"extremes: {ran} of {len(chosen)} cases, {failed} failed", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
