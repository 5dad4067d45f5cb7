"""Checks of a plugin's hooks, and of a backend's class and options, before it is constructed."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError
from pydantic.json_schema import PydanticJsonSchemaWarning

from physic_core.discovery.backends import class_problem
from physic_core.discovery.entry_points import PLUGINS_VARIABLE
from physic_core.discovery.error_text import describe_error
from physic_core.interfaces import INTERFACES
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

HEAVY_MODULES = frozenset((
    "PIL", "cv2", "diffusers", "jax", "kornia", "matplotlib", "numpy", "onnxruntime", "open3d",
    "pandas", "scipy", "skimage", "sklearn", "tensorflow", "timm", "torch", "torchvision",
    "transformers", "trimesh", "ultralytics",
))  # fmt: skip
"""Packages that a module of hooks must not import."""

MAX_REGISTRATION_SECONDS = 0.5
"""Maximum CPU time to import a module of hooks, s."""

_REGISTRATION_SCRIPT = """
import json, sys, time
import physic_core.discovery.plugins, physic_core.interfaces
known, start = set(sys.modules), time.process_time()
broken = [plugin.cause for plugin in physic_core.discovery.plugins.broken_plugins()]
new = sorted({m.partition(".")[0] for m in set(sys.modules) - known})
print(json.dumps({"seconds": time.process_time() - start, "new": new, "broken": broken}))
"""


def check_registration_is_light(subject: BackendUnderTest) -> None:
    """The hooks of the plugin, which `physic --help` calls, import no heavy package; its entry
    points are all read.
    """
    claim = subject.claim
    if claim is None or not claim.version:
        raise CheckSkipped("not of an installed plugin")
    seen = _measure_registration(claim.distribution, tuple(sys.path))
    expect(
        not seen["broken"],
        "entry points that are read, and hooks that can be called",
        "; ".join(seen["broken"]),
    )
    heavy = sorted(HEAVY_MODULES & set(seen["new"]))
    expect(
        not heavy,
        "a module of hooks that imports nothing heavy",
        f"it imports {', '.join(heavy)}",
        "Name what a hook adds as a str, 'package.module:name', and import the other packages in "
        "that module.",
    )
    expect(
        seen["seconds"] < MAX_REGISTRATION_SECONDS,
        f"less than {MAX_REGISTRATION_SECONDS} s of processor time to import the module of hooks",
        f"{seen['seconds']:.1f} s",
        "Move work out of it.",
    )


def check_class_fits_its_interface(subject: BackendUnderTest) -> None:
    """The class is a subclass of its interface with all methods, and `infer` has the parameters of
    the interface.
    """
    wanted = INTERFACES[subject.interface]
    problem = class_problem(subject.kind, subject.interface)
    expect(
        not problem,
        f"a complete subclass of physic_core.interfaces.{wanted.__name__}",
        f"a class that {problem}",
    )


def check_options_refuse_unknown_keys(subject: BackendUnderTest) -> None:
    """`Options` is a pydantic model that rejects unknown keys."""
    options = subject.kind.Options
    is_model = isinstance(options, type) and issubclass(options, BaseModel)
    expect(is_model, "Options to be a subclass of physic_core.interfaces.Options", f"{options!r}")
    try:
        options.model_validate({"no_such_option_": 1})
    except ValidationError as error:
        if any(fault["type"] == "extra_forbidden" for fault in error.errors()):
            return
    raise CheckFailed(
        "an error for unknown options, such as misspelt ones",
        "a model that accepts {'no_such_option_': 1}",
        "Derive Options from physic_core.interfaces.Options and do not change its model_config.",
    )


def check_options_have_defaults(subject: BackendUnderTest) -> None:
    """Every option has a default, so that a config can select the backend by its name alone."""
    required = [
        name for name, field in subject.kind.Options.model_fields.items() if field.is_required()
    ]
    expect(not required, "a default for every option", f"none for {', '.join(required)}")


def check_options_are_described(subject: BackendUnderTest) -> None:
    """Every option has a description, which `physic plugins show` prints."""
    silent = [
        name for name, field in subject.kind.Options.model_fields.items() if not field.description
    ]
    expect(
        not silent,
        "a description of every option: unit and useful values",
        f"none for {', '.join(silent)}",
        "option: float = Field(0.5, description='... m; 0.3-1 works')",
    )


def check_options_survive_json(subject: BackendUnderTest) -> None:
    """Options have a JSON schema and are equal after a JSON round trip."""
    kind = subject.kind.Options
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", PydanticJsonSchemaWarning)
            json.dumps(kind.model_json_schema())
        options = subject.options()
        back = kind.model_validate(json.loads(json.dumps(options.model_dump(mode="json"))))
    except Exception as error:  # pydantic raises many kinds
        raise CheckFailed(
            "options that can be written as JSON", describe_error(error, subject.kind)
        ) from error
    expect(
        back == options, "equal options after a JSON round trip", f"{back!r} instead of {options!r}"
    )


@lru_cache(maxsize=64)
def _measure_registration(distribution: str, path: tuple[str, ...]) -> dict[str, Any]:
    """Call the hooks of a plugin in a new process; return the CPU time, the imported packages and
    the errors.
    """
    import os

    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(p for p in path if p),
        PLUGINS_VARIABLE: distribution,
    }
    command = [sys.executable, "-P", "-c", _REGISTRATION_SCRIPT]
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=120, check=False
    )
    if done.returncode:
        return {"seconds": 0.0, "new": [], "broken": [done.stderr.strip().rpartition("\n")[2]]}
    seen: dict[str, Any] = json.loads(done.stdout.strip().rpartition("\n")[2])
    return seen


_HOOK = "physic_core.discovery.hooks"
_OPTIONS = "physic_core.interfaces.Options"
CHECKS: tuple[Check, ...] = (
    Check(check_registration_is_light, _HOOK),
    Check(check_class_fits_its_interface, "physic_core.interfaces"),
    Check(check_options_refuse_unknown_keys, _OPTIONS),
    Check(check_options_have_defaults, _OPTIONS, after=("options_refuse_unknown_keys",)),
    Check(check_options_are_described, _OPTIONS, after=("options_refuse_unknown_keys",)),
    Check(check_options_survive_json, _OPTIONS, after=("options_have_defaults",)),
)
"""Checks in order of execution."""
