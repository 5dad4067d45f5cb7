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


def test_each_broken_plugin_is_a_row_with_its_cause_and_the_others_are_found(site):
    """All in one registry: none of them takes another away."""
    one = "BackendRecord('inpainter', 'x', 'm:C', api=1)"
    site.install("physic-a", "import no_such_module\n", version="0.3")
    site.install("physic-b", "", entry="b = physic-b/plugin.py")
    site.install("physic-c", "raise SystemExit(3)\n")
    site.install("physic-d", "def physic_backends():\n    return []\n")
    site.install("physic-e", HOOK.replace("physic_backends", "physic_backend") + "    return []\n")
    site.install("physic-f", HOOK + "    return None\n")
    site.install("physic-g", HOOK + f"    return {one}\n")
    site.install("physic-h", HOOK + "    return [('inpainter', 'x', 'm:C')]\n")
    site.install("physic-i", HOOK.replace("()", "(config)") + f"    return [{one}]\n")
    site.install("physic-j", "HOOKS = None\n", entry="j = physic_j:HOOKS")
    site.install("physic-k", HOOK + "    return [BackendRecord('inpainter', 'x', 'm:C')]\n")
    site.install("physic-l", "", entry="twin = physic_z")
    site.offer("physic-z", "inpainter", "good")
    registry = found(site)
    assert names(registry) == ["good"]
    words = (
        "physic-a 0.3 (ModuleNotFoundError: No module named 'no_such_module' (physic_a.py:1))",
        "'b = my_pkg'",
        "SystemExit: 3 (physic_c.py:1)",
        "@hookimpl",
        "no hook named 'physic_backend'",
        "got NoneType",
        "got BackendRecord",
        "tuple in it",
        "{'config'}",
        "'j = my_pkg'",
        "TypeError",
        "'twin = physic_z' of physic-l",
    )
    for word, cause in zip(words, causes(registry), strict=True):
        assert word in cause


def test_a_hook_that_fails_takes_no_other_hook_of_its_plugin_away(site):
    source = HOOK + "    return [BackendRecord('inpainter', 'kept', 'm:C', api=1)]\n"
    site.install("physic-half", source + "@hookimpl\ndef physic_exporters():\n    return 1 / 0\n")
    registry = found(site)
    assert names(registry) == ["kept"]
    (cause,) = causes(registry)
    assert "physic_exporters() fails: ZeroDivisionError" in cause


def test_a_name_that_a_plugin_offers_lazily_is_not_looked_up(site):
    """As of a package that imports its classes at their first use."""
    lazy = "def __dir__(): return ['Heavy', 'physic_backends']\ndef __getattr__(name): raise SystemExit(name)\n"
    site.install("physic-lazy", HOOK + "    return [BackendRecord('inpainter', 'x', 'm:C', api=1)]\n" + lazy)
    registry = found(site)
    assert (names(registry), causes(registry)) == (["x"], [])


def test_output_of_a_plugin_goes_to_stderr(site, capsys):
    hook = HOOK + "    return [BackendRecord('inpainter', 'x', 'm:C', api=1)]\n"
    site.install("physic-loud", "print('Welcome!')\n" + hook)
    assert names(found(site)) == ["x"]
    assert capsys.readouterr() == ("", "Welcome!\n")


def test_a_backend_for_a_newer_version_of_its_interface_is_kept_with_what_to_do(site):
    site.offer("physic-new", "inpainter", "new", api=2)
    registry = found(site)
    assert "upgrade physic-core" in message(BackendError, registry.get, "inpainter", "new")


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
    near, far = (claim.problem for claim in found(site))
    assert "did you mean 'metric_depth'?" in near
    assert "segmenter" in far


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ("'inpainter', 'x', 'm:C', api='1'", "its api should be"),
        ("'inpainter', 'My Fill', 'm:C', api=1", "got 'My Fill'"),
        ("'inpainter', 'none', 'm:C', api=1", "got 'none'"),
        ("'inpainter', 7, 'm:C', api=1", "got 7"),
        ("'inpainter', 'x', 'm.C', api=1", "got 'm.C'"),
    ],
)
def test_a_record_that_cannot_be_used_is_kept_with_what_is_wrong(site, record: str, expected: str):
    site.install("physic-bad", HOOK + f"    return [BackendRecord({record})]\n")
    site.offer("physic-good", "inpainter", "good")
    registry = found(site)
    (bad,) = (c.problem for c in registry if c.origin.distribution == "physic-bad")
    assert expected in bad
    assert registry.get("inpainter", "good").problem == ""


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
    (cause,) = causes(registry)
    assert "physic-bood" in cause


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
        ("return 3", "got int"),
        ("return '/no/such/folder'", "/no/such/folder"),
        ("raise SystemExit(3)", "SystemExit: 3 (physic_own.py:8)"),
    ],
)
def test_a_wrong_list_of_weights_is_a_row_and_takes_no_backend_away(site, body: str, says: str):
    site.install("physic-own", WITH_WEIGHTS + f"    {body}\n")
    registry = discover(site.entries())
    (cause,) = causes(registry)
    assert says in cause
    assert registry.names("segmenter") == ("own",)
    assert registry.manifests == ()
