"""Checks of a plugin's hooks and weights, and of a backend's class and options."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel
from pydantic.json_schema import PydanticJsonSchemaWarning

from physic_core.discovery.backends import class_problem
from physic_core.discovery.entry_points import PLUGINS_VARIABLE
from physic_core.discovery.error_text import describe_error
from physic_core.interfaces import INTERFACES
from physic_core.weights import named_sets
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.discovery.entry_points import Offer
    from physic_testing.conformance.backend_under_test import BackendUnderTest

HEAVY_MODULES = frozenset(
    [
        "PIL",
        "cv2",
        "diffusers",
        "jax",
        "kornia",
        "matplotlib",
        "numpy",
        "onnxruntime",
        "open3d",
        "pandas",
        "scipy",
        "skimage",
        "sklearn",
        "tensorflow",
        "timm",
        "torch",
        "torchvision",
        "transformers",
        "trimesh",
        "ultralytics",
    ]
)
"""Packages that a module of hooks must not import."""

MAX_REGISTRATION_SECONDS = 0.5
"""Maximum CPU time to import a module of hooks, s."""

_REGISTRATION_SCRIPT = """
import json, sys, time
import physic_core.discovery.plugins, physic_core.interfaces
before, start = set(sys.modules), time.process_time()
broken = [plugin.cause for plugin in physic_core.discovery.plugins.broken_plugins()]
new = sorted({m.partition(".")[0] for m in set(sys.modules) - before})
print(json.dumps({"seconds": time.process_time() - start, "new": new, "broken": broken}))
"""


def check_registration_is_light(subject: BackendUnderTest) -> None:
    """The hooks of the plugin, which `physic --help` calls, import no heavy package and raise
    nothing.
    """
    registration = _measure_registration(_offer(subject).distribution, tuple(sys.path))
    expect(
        not registration["broken"], "hooks that can be called", "; ".join(registration["broken"])
    )
    heavy = sorted(HEAVY_MODULES & set(registration["new"]))
    expect(
        not heavy and registration["seconds"] < MAX_REGISTRATION_SECONDS,
        f"hooks without heavy imports, in {MAX_REGISTRATION_SECONDS} s of processor time",
        f"it imports {', '.join(heavy) or 'nothing heavy'}, in {registration['seconds']:.1f} s",
        "Name what a hook adds as a str, 'package.module:name', and import the rest there.",
    )


def check_class_fits_its_interface(subject: BackendUnderTest) -> None:
    """The class is a subclass of its interface with all methods, and `infer` has the parameters of
    the interface.
    """
    wanted = INTERFACES[subject.interface].__name__
    problem = class_problem(subject.kind, subject.interface)
    expect(
        not problem,
        f"a complete subclass of physic_core.interfaces.{wanted}",
        f"a class that {problem}",
    )


def check_options_are_complete(subject: BackendUnderTest) -> None:
    """`Options` rejects unknown keys; every option has a default and a description, and survives
    JSON.
    """
    options = subject.kind.Options
    is_model = isinstance(options, type) and issubclass(options, BaseModel)
    expect(is_model, "a subclass of physic_core.interfaces.Options", f"{options!r}")
    expect(
        options.model_config.get("extra") == "forbid",
        "an error for unknown options, such as misspelled ones",
        "Options that accept any key",
        "Derive Options from physic_core.interfaces.Options and do not change its model_config.",
    )
    unset = [name for name, field in options.model_fields.items() if field.is_required()]
    expect(not unset, "a default for every option", f"none for {', '.join(unset)}")
    silent = [name for name, field in options.model_fields.items() if not field.description]
    expect(
        not silent,
        "a description of every option: unit and useful values",
        f"none for {', '.join(silent)}",
        "option: float = Field(0.5, description='... m; 0.3-1 works')",
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", PydanticJsonSchemaWarning)
            json.dumps(options.model_json_schema())
        chosen = subject.options_for()
        back = options.model_validate(json.loads(json.dumps(chosen.model_dump(mode="json"))))
    except Exception as error:  # pydantic raises many kinds
        error_text = describe_error(error, subject.kind)
        raise CheckFailed("options that can be written as JSON", error_text) from error
    expect(
        back == chosen, "equal options after a JSON round trip", f"{back!r} instead of {chosen!r}"
    )


def check_default_weights_are_listed(subject: BackendUnderTest) -> None:
    """The default of the option `weights` is a set that a manifest of the plugin lists, with its
    licence.
    """
    offer = _offer(subject)
    field = subject.kind.Options.model_fields.get("weights")
    default = None if field is None else field.get_default()
    if not isinstance(default, str) or not default:
        raise CheckSkipped("its options name no weights by default")
    expect(
        bool(named_sets(offer.distribution, {"weights": default})),
        f"a weight set '{default}' in a manifest of {offer.distribution}",
        "none of this name",
        'Name the package of the manifests in [project.entry-points."physic.weights"].',
    )


def _offer(subject: BackendUnderTest) -> Offer:
    """Return the entry point of the backend, or skip the check."""
    if subject.claim is None or not subject.claim.version:
        raise CheckSkipped("not of an installed plugin")
    return subject.claim


@lru_cache(maxsize=64)
def _measure_registration(distribution: str, path: tuple[str, ...]) -> dict[str, Any]:
    """Call the hooks of a plugin in a new process; return CPU time, imports and errors."""
    variables = {
        "PYTHONPATH": os.pathsep.join(p for p in path if p),
        PLUGINS_VARIABLE: distribution,
    }
    command = [sys.executable, "-P", "-c", _REGISTRATION_SCRIPT]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env=os.environ | variables,
        timeout=120,
        check=False,
    )
    if done.returncode:
        return {"seconds": 0.0, "new": [], "broken": [done.stderr.strip().rpartition("\n")[2]]}
    registration: dict[str, Any] = json.loads(done.stdout.strip().rpartition("\n")[2])
    return registration


CHECKS: tuple[Check, ...] = (
    Check(check_registration_is_light, read="physic_core.discovery.hooks"),
    Check(check_class_fits_its_interface),
    Check(check_options_are_complete, read="physic_core.interfaces.Options"),
    Check(check_default_weights_are_listed, read="physic_core.weights.manifest"),
)
"""Checks in order of execution."""
