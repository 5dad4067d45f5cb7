"""Hooks of installed plugins, restrictions to some of them, and lists of weights."""

from __future__ import annotations

import pytest

from physic_core import list_backends
from physic_core.discovery.catalog import COMMANDS, ENGINE_PRESETS, EXECUTORS
from physic_core.discovery.plugins import broken_plugins, find_items
from physic_core.weights.library import read_library

pytestmark = pytest.mark.quick

HOOK = "from physic_core import PluginItem, hookimpl\n@hookimpl\ndef physic_commands():\n"
GOOD = HOOK + "    return [PluginItem('good', 'm:c')]\n"


def names():
    """The commands of plugins that are no part of the project."""
    return [
        found.record.name for found in find_items("physic_commands") if found.version != "0.1.0"
    ]


def causes():
    return [str(plugin) for plugin in broken_plugins()]


def test_each_broken_plugin_is_a_row_with_its_cause_and_the_others_are_found(site, physic):
    """All at once: none of them takes another away."""
    site.install("physic-a", "import no_such_module\n", version="0.3")
    site.install("physic-b", "", entry="b = physic-b/plugin.py")
    site.install("physic-c", "raise SystemExit(3)\n")
    site.install("physic-d", "def physic_commands():\n    return []\n")
    site.install("physic-e", HOOK.replace("physic_commands", "physic_backends") + "    return []\n")
    site.install("physic-f", HOOK + "    return 3\n")
    site.install("physic-h", HOOK + "    return [('good', 'm:c')]\n")
    site.install("physic-i", HOOK.replace("()", "(config)") + "    return []\n")
    site.install("physic-j", "HOOKS = None\n", entry="j = physic_j:HOOKS")
    site.install("physic-k", HOOK + "    return [PluginItem('good')]\n")
    other = site.install("no-plugin", "")
    for entries in site.folder.glob(f"{other}-*/entry_points.txt"):
        entries.write_bytes(b"[console_scripts]\n\xff = no_plugin:main\n")
    site.install("physic-z", GOOD)
    assert names() == ["good"]
    words = (
        "physic-a 0.3 (ModuleNotFoundError: No module named 'no_such_module' (physic_a.py:1))",
        "physic-b/plugin",
        "SystemExit: 3 (physic_c.py:1)",
        "@hookimpl",
        "unknown hook 'physic_backends'",
        "TypeError",
        "a list of PluginItem, got ('good', 'm:c')",
        "{'config'}",
        "physic_j:HOOKS",
        "TypeError",
    )
    for word, cause in zip(words, causes(), strict=True):
        assert word in cause
    done = physic("plugins")
    assert done.exit_code == 0
    assert [
        line
        for line in done.stdout.splitlines()
        if line.startswith("BROKEN: physic-c 1.0 (SystemExit: 3")
    ]
    assert physic("--help").exit_code == 0


@pytest.mark.parametrize(
    ("hook", "known"),
    [
        ("physic_commands", COMMANDS),
        ("physic_engine_presets", ENGINE_PRESETS),
        ("physic_executors", EXECUTORS),
    ],
)
def test_the_catalog_says_what_the_plugins_of_the_project_add(hook, known):
    added = {found.record.name: found.distribution for found in find_items(hook)}
    assert {name: owner for name, owner in known.items() if owner in added.values()} == added


def test_a_hook_that_fails_takes_no_other_hook_of_its_plugin_away(site):
    site.install("physic-half", GOOD + "@hookimpl\ndef physic_exporters():\n    return 1 / 0\n")
    assert names() == ["good"]
    (cause,) = causes()
    assert "ZeroDivisionError" in cause


def test_a_name_that_a_plugin_offers_lazily_is_not_looked_up(site):
    """As of a package that imports its classes at their first use."""
    lazy = (
        "def __dir__(): return ['Heavy', 'physic_commands']\ndef __getattr__(name): raise "
        "SystemExit(name)\n"
    )
    site.install("physic-lazy", GOOD + lazy)
    assert (names(), causes()) == (["good"], [])


def test_output_of_a_plugin_goes_to_stderr(site, capsys):
    site.install("physic-loud", "print('Welcome!')\n" + GOOD)
    assert names() == ["good"]
    assert capsys.readouterr() == ("", "Welcome!\n")


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("physic.metric-depth", "Did you mean 'physic.metric_depth'?"),
        ("physic.plugin", "Did you mean 'physic.plugins'?"),
        ("physic_weights", "Did you mean 'physic.weights'?"),
        ("physic.music", "nothing reads its entry points of the group 'physic.music'"),
    ],
)
def test_a_misspelt_group_is_a_row(site, group, words):
    site.install("physic-bad", "", entry="x = physic_bad:X", group=group)
    (cause,) = causes()
    assert cause.startswith("physic-bad 1.0 (")
    assert words in cause


# ---- restrictions
# --------------------------------------------------------------------------------------------------


def test_a_restriction_leaves_the_named_plugins_and_does_not_import_the_others(site, monkeypatch):
    site.install("physic-bad", "import no_such_module\n")
    site.offer("physic-good", "inpainter", "good")
    site.offer("physic-fine", "inpainter", "fine")
    for written in ("physic-good", "Physic_Good", " physic-good ,"):
        monkeypatch.setenv("PHYSIC_PLUGINS", written)
        assert [offer.name for offer in list_backends()] == ["good"]
        assert causes() == []


def test_a_restriction_to_what_is_not_there_is_reported(site, monkeypatch):
    site.offer("physic-good", "inpainter", "good")
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-good,physic-bood")
    (cause,) = causes()
    assert "physic-bood" in cause


# ---- lists of weights
# ------------------------------------------------------------------------------------------------

NET = """
[net]
summary = "A network"
license = "MIT"
files = [{path = "net.onnx", source = "https://example.org/net.onnx"}]
"""


def with_weights(site, text, target="physic_nets.weights"):
    package = site.folder / "physic_nets"
    (package / "weights").mkdir(parents=True)
    (package / "__init__.py").write_text("raise SystemExit('imported')")
    (package / "weights" / "net.toml").write_text(text)
    site.install("physic-own", "", entry=f"own = {target}", group="physic.weights")


def test_a_list_of_weights_is_read_without_importing_its_package(site):
    with_weights(site, NET)
    library = read_library()
    assert library.broken == ()
    assert library.get("physic-own:net").weights.license == "MIT"


@pytest.mark.parametrize(
    ("text", "target", "says"),
    [
        (NET.replace('license = "MIT"\n', ""), "physic_nets.weights", "license"),
        (
            NET,
            "physic_nets.no_such_folder",
            "there is no folder of the package physic_nets.no_such_folder",
        ),
        (NET, "no_such_package", "there is no folder of the package no_such_package"),
    ],
    ids=["no licence", "no folder", "no package"],
)
def test_a_wrong_list_of_weights_is_told_by_the_command(site, text, target, says, physic):
    with_weights(site, text, target)
    ((offer, why),) = read_library().broken
    assert offer.distribution == "physic-own"
    assert says in why
    done = physic("weights", "list")
    assert (done.exit_code, "BROKEN" in done.stdout) == (0, True)
