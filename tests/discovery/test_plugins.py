from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from physic_core import engine_preset_names
from physic_core.discovery.plugins import discover
from physic_core.discovery.registry import Registry
from physic_core.errors import BackendError
from physic_core.interfaces import INTERFACES

HOOK = "from physic_core import BackendRecord, hookimpl\n@hookimpl\ndef physic_backends():\n"


def found(site: Any, **environment: str) -> Registry:
    return discover(site.entries(), environment=environment, clock=iter(range(100)).__next__)


def causes(registry: Registry) -> list[str]:
    return [str(b) for b in registry.broken]


def message(kind: type[Exception], do: Callable[..., object], *arguments: object) -> str:
    with pytest.raises(kind) as caught:
        do(*arguments)
    return str(caught.value)


def names(registry: Registry) -> list[str]:
    return [c.record.name for c in registry]


def test_a_record_is_stamped_with_who_made_it(site):
    site.offer("physic-one", "inpainter", "one", version="1.2")
    (claim,) = found(site)
    origin = claim.origin
    assert (origin.plugin, origin.distribution, origin.version) == ("physic_one", "physic-one", "1.2")
    assert claim.problem == ""


@pytest.mark.parametrize(
    ("source", "entry", "cause"),
    [
        (
            "import no_such_module\n",
            "",
            "ModuleNotFoundError: No module named 'no_such_module' (physic_bad.py:1)",
        ),
        (
            "",
            "bad = physic-bad/plugin.py",
            "its entry point 'bad = physic-bad/plugin.py' should name a module: 'bad = my_pkg'",
        ),
    ],
)
def test_a_broken_plugin_is_a_row_with_its_cause_and_the_others_are_found(site, source, entry, cause):
    site.install("physic-bad", source, version="0.3", entry=entry)
    site.offer("physic-good", "inpainter", "good")
    registry = found(site)
    assert names(registry) == ["good"]
    assert causes(registry) == [f"physic-bad 0.3 ({cause})"]


def test_output_of_a_plugin_goes_to_stderr(site, capsys):
    hook = HOOK + "    return [BackendRecord('inpainter', 'x', 'm:C', api=1)]\n"
    site.install("physic-loud", "print('Welcome!')\n" + hook)
    assert names(found(site)) == ["x"]
    assert capsys.readouterr() == ("", "Welcome!\n")


def test_a_misspelt_hook_is_found(site):
    site.install("physic-bad", HOOK.replace("physic_backends", "physic_backend") + "    return []\n")
    assert causes(found(site)) == [
        "physic-bad 1.0 (there is no hook named 'physic_backend'; "
        "there are 'physic_backends', 'physic_commands', 'physic_exporters', 'physic_weights')"
    ]


def test_a_hook_without_its_decorator_is_reported(site):
    site.install("physic-bad", "def physic_backends():\n    return []\n")
    assert causes(found(site)) == ["physic-bad 1.0 (physic_bad has no function physic_backends marked with @hookimpl)"]


def test_a_hook_that_returns_another_type_is_reported(site):
    site.install("physic-bad", HOOK + "    return BackendRecord('inpainter', 'x', 'm:C', api=1)\n")
    site.install("physic-mad", HOOK + "    return [('inpainter', 'x', 'm:C')]\n")
    assert causes(found(site)) == [
        "physic-bad 1.0 (physic_backends() must return a list of BackendRecord, got BackendRecord)",
        "physic-mad 1.0 (physic_backends() must return a list of BackendRecord, got a list with tuple in it)",
    ]


def test_a_backend_for_a_newer_version_of_its_interface_is_kept_with_what_to_do(site):
    site.offer("physic-new", "inpainter", "new", api=2)
    registry = found(site)
    assert message(BackendError, registry.get, "inpainter", "new") == (
        "inpainter 'new' (physic-new 1.0) cannot be used: "
        "written for version 2 of the interface inpainter, and this physic-core has version 1: upgrade physic-core"
    )


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_new_version_of_an_interface_refuses_the_backends_of_that_one_alone(site, monkeypatch, interface: str):
    for other in INTERFACES:
        site.offer(f"third-party-{other.replace('_', '-')}", other, "theirs")
    assert [claim for claim in discover(environment={}) if claim.problem] == []
    monkeypatch.setattr(INTERFACES[interface], "api", INTERFACES[interface].api + 1)
    registry = discover(environment={})
    refused = [claim for claim in registry if claim.problem]
    assert refused == [claim for claim in registry if claim.record.interface == interface]
    owners = {claim.origin.distribution for claim in refused}
    assert {"physic-embedded", "physic-mock", f"third-party-{interface.replace('_', '-')}"} <= owners


def test_a_backend_for_an_unknown_interface_suggests_a_close_name(site):
    site.offer("physic-a", "metric-depth", "x")
    site.offer("physic-b", "music", "x")
    assert [c.problem for c in found(site)] == [
        "no interface named 'metric-depth'; did you mean 'metric_depth'?",
        "no interface named 'music'; there are: segmenter, inpainter, metric_depth, relative_pointmap, "
        "keypoint_detector, body_estimator, hand_estimator, contact_prior",
    ]


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ("'inpainter', 'x', 'm:C', api='1'", "its api should be a whole number such as 1, got '1'"),
        (
            "'inpainter', 'My Fill', 'm:C', api=1",
            "its name should be of a-z, 0-9 and hyphens, and not 'none', got 'My Fill'",
        ),
        ("'inpainter', 'none', 'm:C', api=1", "its name should be of a-z, 0-9 and hyphens, and not 'none', got 'none'"),
        ("'inpainter', 7, 'm:C', api=1", "its name should be of a-z, 0-9 and hyphens, and not 'none', got 7"),
        ("'inpainter', 'x', 'm.C', api=1", "its target should be 'package.module:Class', got 'm.C'"),
    ],
)
def test_a_record_that_cannot_be_used_is_kept_with_what_is_wrong(site, record: str, expected: str):
    site.install("physic-bad", HOOK + f"    return [BackendRecord({record})]\n")
    site.offer("physic-good", "inpainter", "good")
    registry = found(site)
    assert [c.problem for c in registry if c.origin.distribution == "physic-bad"] == [expected]
    assert registry.get("inpainter", "good").problem == ""


def test_a_record_without_a_version_of_its_interface_breaks_its_plugin(site):
    site.install("physic-bad", HOOK + "    return [BackendRecord('inpainter', 'x', 'm:C')]\n")
    (cause,) = causes(found(site))
    assert "missing 1 required positional argument: 'api'" in cause


def test_a_restriction_leaves_the_named_plugins_and_does_not_import_the_others(site):
    site.install("physic-bad", "import no_such_module\n")
    site.offer("physic-good", "inpainter", "good")
    site.offer("physic-fine", "inpainter", "fine")
    for written in ("physic-good", "good", "physic_good", " physic-good ,"):
        registry = found(site, PHYSIC_PLUGINS=written)
        assert names(registry) == ["good"]
        assert registry.broken == ()
        assert registry.restriction == written


def test_a_restriction_keeps_all_entry_points_of_a_distribution(site, monkeypatch):
    """Its energies too, by the name of any of its entry points."""
    site.install("physic-soft", "", entry="soft = physic_soft:SOFT\nhard = physic_soft:HARD", group="physic.energies")
    site.install("physic-other", "", entry="other = physic_other:SOFT", group="physic.energies")
    for written in ("physic-soft", "hard"):
        monkeypatch.setenv("PHYSIC_PLUGINS", written)
        assert engine_preset_names() == ("default", "hard", "soft")
        assert discover().broken == ()


def test_a_restriction_to_what_is_not_there_is_reported(site):
    site.offer("physic-good", "inpainter", "good")
    registry = found(site, PHYSIC_PLUGINS="physic-good,physic-bood")
    assert names(registry) == ["good"]
    assert causes(registry) == ["physic-bood (named in PHYSIC_PLUGINS but not installed)"]


def test_two_distributions_may_claim_one_name_and_both_are_kept(site):
    site.offer("physic-a", "inpainter", "x")
    site.offer("physic-b", "inpainter", "x")
    registry = found(site)
    claims = list(registry)
    assert [c.origin.distribution for c in claims] == ["physic-a", "physic-b"]
    assert registry.with_same_name(claims[0]) == (claims[1],)


# ---- lists of weights ------------------------------------------------------------------------------------------------

WITH_WEIGHTS = (
    "from pathlib import Path\n"
    "from physic_core import BackendRecord, hookimpl\n"
    "@hookimpl\n"
    "def physic_backends():\n"
    "    return [BackendRecord('segmenter', 'own', 'json:JSONDecoder', api=1)]\n"
    "@hookimpl\n"
    "def physic_weights():\n"
)


def test_a_list_of_weights_is_known_and_not_read(site):
    site.install("physic-own", WITH_WEIGHTS + "    return Path(__file__).parent / 'own.toml'\n")
    path = site.folder / "own.toml"
    path.write_text("this is not TOML")
    registry = discover(site.entries())
    assert [(m.origin.distribution, m.path) for m in registry.manifests] == [("physic-own", path)]
    assert registry.broken == ()


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("return 3", "physic_weights() must return the path of a TOML file or folder, got int"),
        ("return None", "physic_weights() must return the path of a TOML file or folder, got NoneType"),
        ("return '/no/such/folder'", "physic_weights() names /no/such/folder, which does not exist"),
        ("raise RuntimeError('no')", "physic_weights() fails: RuntimeError: no (physic_own.py:8)"),
        ("raise SystemExit(3)", "physic_weights() fails: SystemExit: 3 (physic_own.py:8)"),
    ],
)
def test_a_wrong_list_of_weights_is_a_row_and_takes_no_backend_away(site, body: str, says: str):
    site.install("physic-own", WITH_WEIGHTS + f"    {body}\n")
    registry = discover(site.entries())
    assert [str(b) for b in registry.broken] == [f"physic-own 1.0 ({says})"]
    assert registry.names("segmenter") == ("own",)
    assert registry.manifests == ()
