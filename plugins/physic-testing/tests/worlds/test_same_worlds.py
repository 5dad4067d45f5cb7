"""A world and the mocks' answers are the same in every bit, whatever the CPU's vectors, the kernels
and the threads.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import numpy as np
import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        platform.machine() not in ("x86_64", "AMD64"), reason="kernels are named for x86-64"
    ),
]

_FOUND = np.show_config(mode="dicts")["SIMD Extensions"]["found"]

# Environment of a process: OpenBLAS and ATen by name, numpy by what it may not use.
_PLAIN = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "ATEN_CPU_CAPABILITY": "default",
    "NPY_DISABLE_CPU_FEATURES": " ".join(_FOUND),
    "OMP_NUM_THREADS": "2",
}
_AVX2 = {
    "OPENBLAS_CORETYPE": "Haswell",
    "ATEN_CPU_CAPABILITY": "avx2",
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        name for name in _FOUND if name.startswith(("X86_V4", "AVX512"))
    ),
    "OMP_NUM_THREADS": "1",
}
_BEST = {
    "OPENBLAS_CORETYPE": "",
    "ATEN_CPU_CAPABILITY": "",
    "NPY_DISABLE_CPU_FEATURES": "",
    "OMP_NUM_THREADS": "2",
}

_DIGESTS = """
import hashlib, sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
import numpy as np
from physic_core import load_config
from physic_core.body import load_body
from physic_core.pipeline.estimate import run_backends
from physic_core.configuration.resolve import resolve
from physic_core.pipeline.stage_runner import StageRunner
from physic_testing.worlds import build_world

def show(name, value):
    if isinstance(value, np.ndarray):
        print(name, value.dtype, value.shape, hashlib.sha256(value.tobytes()).hexdigest())
    elif isinstance(value, Mapping):
        for key in sorted(value):
            show(name + "." + key, value[key])
    elif is_dataclass(value):
        for field in fields(value):
            show(name + "." + field.name, getattr(value, field.name))
    else:
        print(name, repr(value))

plan = resolve(load_config(preset="mock"))
model = load_body(plan.body_model)
for argument in sys.argv[1:]:
    name, seed = argument.split(":")
    world = build_world(name, int(seed), (96, 72))
    show(argument, world)
    stages = StageRunner(plan.device, len(plan.backends) + 6, None)
    evidence = run_backends(world.image, None, plan, lambda: model, stages)
    stages.close()
    for field in fields(evidence):
        if field.name not in ("floor", "stance", "ages"):  # fitted by the pipeline
            show(argument + " " + field.name, getattr(evidence, field.name))
"""


def _digests(environment: dict[str, str], *worlds: str) -> list[str]:
    changed = {**os.environ, **environment, "PHYSIC_WORLD_CACHE": "off"}
    # What is empty is not set: an empty name is a name to some libraries.
    changed = {name: value for name, value in changed.items() if value}
    run = subprocess.run(
        [sys.executable, "-c", _DIGESTS, *worlds],
        env=changed,
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.splitlines()


@pytest.mark.skipif(
    "X86_V3" not in _FOUND and "AVX2" not in _FOUND,
    reason="a CPU without AVX2 has no other kernels",
)
def test_a_world_has_the_same_bits_under_all_kernels() -> None:
    worlds = "walk:3", "lean_on_table:1", "slope:2"
    best, *others = (_digests(environment, *worlds) for environment in (_BEST, _AVX2, _PLAIN))
    assert len(best) > 50 * len(worlds)
    for other in others:
        assert other == best
