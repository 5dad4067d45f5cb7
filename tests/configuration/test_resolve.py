from __future__ import annotations

from typing import Any

import pytest
from pydantic import Field

from physic_core import interfaces
from physic_core.configuration.model import Config, load_config
from physic_core.configuration.resolve import check_backends, resolve
from physic_core.discovery.plugins import discover
from physic_core.discovery.registry import BackendRecord, Origin, Registry
from physic_core.errors import BackendError, ConfigError, PhysicError
from physic_core.interfaces import INTERFACES

OWNER = Origin("mine", "physic-mine", "0.2")


class DepthOptions(interfaces.Options):
    resolution_level: int = Field(9, ge=1, le=9, description="detail")
    mode: str = Field("fast", description="speed")


def backend(interface: str, options: type[interfaces.Options] = interfaces.Options) -> type[interfaces.Backend]:
    """A class that implements an interface with a method that does nothing."""
    base = INTERFACES[interface]
    return type("Own", (base,), {"infer": lambda self, *args: None, "Options": options})


def registry(**others: Any) -> Registry:
    """One backend "own" for every interface, with other classes for the named ones."""
    own = Registry(installed=False)
    for name in INTERFACES:
        options = DepthOptions if name == "metric_depth" else interfaces.Options
        kind = others.get(name, backend(name, options))
        own.register(BackendRecord(name, "own", kind, api=1, weights_license="MIT (Own)"), OWNER)
    return own


def config(**tables: Any) -> Config:
    choices: dict[str, Any] = {name: {"backend": "own"} for name in INTERFACES}
    return load_config(flags={"config": choices | tables})


def refusal(chosen: Config, own: Registry, kind: type[PhysicError] = ConfigError) -> str:
    with pytest.raises(kind) as caught:
        check_backends(chosen, own)
    return str(caught.value)


def test_every_interface_gets_its_backend_with_options_and_provenance():
    table = {"backend": "own", "options": {"resolution_level": 3}}
    pipeline = resolve(config(metric_depth=table), registry())
    assert list(pipeline.backends) == list(INTERFACES)
    depth = pipeline.backends["metric_depth"]
    assert isinstance(depth.backend, interfaces.MetricDepth)
    assert isinstance(depth.backend.options, DepthOptions)
    assert depth.backend.options.resolution_level == 3
    assert depth.title == "metric_depth 'own' (physic-mine 0.2)"
    who = depth.provenance
    assert (who.plugin, who.distribution, who.version) == ("mine", "physic-mine", "0.2")
    assert who.weights_license == "MIT (Own)"
    assert who.options == {"resolution_level": 3, "mode": "fast"}


def test_faults_of_names_and_options_are_reported_together():
    tables = {
        "inpainter": {"backend": "onw"},
        "metric_depth": {"backend": "own", "options": {"resolution_level": 12, "resolution_levle": 3}},
    }
    lines = refusal(config(**tables), registry()).splitlines()
    for start, word in (
        ("config: inpainter.backend: ", "Did you mean 'own'?"),
        ("config: metric_depth.options.resolution_level: ", "(got 12)"),
        ("config: metric_depth.options.resolution_levle: ", "Did you mean 'resolution_level'?"),
    ):
        (line,) = [line for line in lines if line.startswith(start)]
        assert word in line


def test_two_claims_to_the_chosen_name_are_one_of_the_faults():
    own = registry()
    own.register(BackendRecord("inpainter", "own", backend("inpainter"), api=1), Origin("b", "physic-b", "2.0"))
    assert "write 'physic-b:own' or 'physic-mine:own' to choose" in refusal(config(), own)
    pipeline = resolve(config(inpainter={"backend": "physic-b:own"}), own)
    assert pipeline.backends["inpainter"].provenance.version == "2.0"


@pytest.mark.parametrize("preset", ["embedded", "mock"])
def test_a_third_party_with_the_names_of_a_preset_does_not_break_the_preset(site, preset: str):
    for interface in INTERFACES:
        site.offer(f"physic-mine-{interface.replace('_', '-')}", interface, preset)
    both = discover(environment={})
    chosen = resolve(load_config(preset=preset), both).backends
    assert {r.provenance.distribution for r in chosen.values()} == {f"physic-{preset}"}
    assert {r.provenance.backend for r in chosen.values()} == {preset}
    # Only who uses the bare name has to choose.
    owners = sorted((f"physic-{preset} 0.1.0", "physic-mine-inpainter 1.0"))
    names = [f"{owner.partition(' ')[0]}:{preset}" for owner in owners]
    message = refusal(load_config(preset=preset, overrides=[f"inpainter.backend={preset}"]), both)
    assert f"write '{names[0]}' or '{names[1]}' to choose" in message
    assert resolve(load_config(preset=preset, overrides=["inpainter.backend=telea"]), both)


def test_a_method_that_takes_other_arguments_is_found_before_it_is_called():
    kind = type("Own", (backend("inpainter"),), {"infer": lambda self, image: image})
    message = refusal(config(), registry(inpainter=kind), BackendError)
    assert "infer(self, image) should take image, mask" in message


@pytest.mark.parametrize(
    "infer",
    [
        staticmethod(lambda image, mask: image),
        classmethod(lambda kind, image, mask: image),
        lambda self, *inputs: inputs[0],
        lambda self, image, mask, radius=3: image,
    ],
)
def test_a_method_that_can_be_called_passes(infer: Any):
    kind = type("Own", (backend("inpainter"),), {"infer": infer})
    assert resolve(config(), registry(inpainter=kind))


@pytest.mark.parametrize(
    ("fault", "said"), [(ValueError("no seat free"), "ValueError: no seat free"), (SystemExit(3), "SystemExit: 3")]
)
def test_a_constructor_that_fails_is_named(fault: BaseException, said: str):
    def fail(self: Any, options: Any) -> None:
        raise fault

    kind = type("Own", (backend("inpainter"),), {"__init__": fail})
    with pytest.raises(BackendError, match=rf"inpainter 'own' \(physic-mine 0.2\) .*{said}"):
        resolve(config(), registry(inpainter=kind))


def test_a_class_that_lacks_a_method_is_refused():
    kind = type("Own", (interfaces.Inpainter,), {})
    message = refusal(config(), registry(inpainter=kind), BackendError)
    assert "has no method infer" in message
