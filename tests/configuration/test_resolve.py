from __future__ import annotations

import pytest
from pydantic import Field

from physic_core import interfaces
from physic_core.configuration.model import load_config
from physic_core.configuration.resolve import resolve
from physic_core.errors import BackendError, ConfigError
from physic_core.interfaces import INTERFACES

pytestmark = pytest.mark.quick


class DepthOptions(interfaces.Options):
    resolution_level: int = Field(9, ge=1, le=9, description="detail")
    mode: str = Field("fast", description="speed")


def backend(interface, options=interfaces.Options):
    """A class that implements an interface with a method that does nothing."""
    base = INTERFACES[interface]
    return type(
        "Own",
        (base,),
        {"infer": lambda self, *args: None, "Options": options, "weights_license": "MIT (Own)"},
    )


@pytest.fixture
def own(site):
    """Install one backend "own" for every interface, with other classes for the named ones."""

    def install(**others):
        kinds = {name: backend(name) for name in INTERFACES}
        kinds["metric_depth"] = backend("metric_depth", DepthOptions)
        site.put(kinds | others)

    return install


def config(**tables):
    choices = {name: {"backend": "own"} for name in INTERFACES}
    return load_config(flags={"config": choices | tables})


def refusal(chosen, kind=ConfigError):
    with pytest.raises(kind) as caught:
        resolve(chosen)
    return str(caught.value)


def test_every_interface_gets_its_backend_with_options_and_provenance(own):
    own()
    table = {"backend": "own", "options": {"resolution_level": 3}}
    pipeline = resolve(config(metric_depth=table))
    assert list(pipeline.backends) == list(INTERFACES)
    depth = pipeline.backends["metric_depth"]
    assert isinstance(depth.backend, interfaces.MetricDepth)
    assert isinstance(depth.backend.options, DepthOptions)
    assert depth.backend.options.resolution_level == 3
    assert depth.title == "metric_depth 'own' (physic-mine 0.2)"
    who = depth.provenance
    assert (who.distribution, who.version) == ("physic-mine", "0.2")
    assert who.weights_license == "MIT (Own)"
    assert who.options == {"resolution_level": 3, "mode": "fast"}


def test_faults_of_names_and_options_are_reported_together(own):
    own()
    tables = {
        "inpainter": {"backend": "onw"},
        "metric_depth": {
            "backend": "own",
            "options": {"resolution_level": 12, "resolution_levle": 3},
        },
    }
    lines = refusal(config(**tables)).splitlines()
    for start, word in (
        ("config: inpainter.backend: ", "Did you mean 'own'?"),
        ("config: metric_depth.options.resolution_level: ", "(got 12)"),
        ("config: metric_depth.options.resolution_levle: ", "Did you mean 'resolution_level'?"),
    ):
        (line,) = [line for line in lines if line.startswith(start)]
        assert word in line


@pytest.mark.parametrize(
    ("preset", "owner"), [("embedded", "metricbody-embedded"), ("mock", "metricbody-testing")]
)
def test_a_third_party_with_the_names_of_a_preset_does_not_break_the_preset(site, preset, owner):
    for interface in INTERFACES:
        site.offer(f"physic-mine-{interface.replace('_', '-')}", interface, preset)
    chosen = resolve(load_config(preset=preset)).backends
    assert {r.provenance.distribution for r in chosen.values()} == {owner}
    assert {r.provenance.backend for r in chosen.values()} == {preset}
    # Only who uses the bare name has to choose.
    owners = sorted((f"{owner} 0.1.0", "physic-mine-inpainter 1.0"))
    names = [f"{owner.partition(' ')[0]}:{preset}" for owner in owners]
    message = refusal(load_config(preset=preset, overrides=[f"inpainter.backend={preset}"]))
    assert f"write '{names[0]}' or '{names[1]}' to choose" in message
    assert resolve(load_config(preset=preset, overrides=["inpainter.backend=telea"]))


@pytest.mark.parametrize(
    "infer",
    [
        staticmethod(lambda image, mask: image),
        classmethod(lambda kind, image, mask: image),
        lambda self, *inputs: inputs[0],
        lambda self, image, mask, radius=3: image,
    ],
)
def test_a_method_that_can_be_called_passes(own, infer):
    kind = type("Own", (backend("inpainter"),), {"infer": infer})
    own(inpainter=kind)
    assert resolve(config())


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (RuntimeError("no seat free"), "RuntimeError: no seat free"),
        (SystemExit(3), "SystemExit: 3"),
    ],
)
@pytest.mark.parametrize("method", ["__init__", "model_post_init", "model_dump"])
def test_a_constructor_or_options_that_fail_are_named(own, method, fault, said):
    def fail(self, *_, **__):
        raise fault

    of_options, of_class = ({}, {method: fail}) if method == "__init__" else ({method: fail}, {})
    options = type("Options", (interfaces.Options,), of_options)
    own(inpainter=type("Own", (backend("inpainter", options),), of_class))
    with pytest.raises(BackendError, match=rf"inpainter 'own' \(physic-mine 0.2\) .*{said}"):
        resolve(config())
