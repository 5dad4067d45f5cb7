"""Energies of plugins: found by name, checked, and named with their distribution where they are
missing.
"""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from physic_core import engine_preset, engine_preset_names, load_config
from physic_core.cli import main
from physic_core.errors import ConfigError, PluginError

PRESET = """
from dataclasses import replace
from physic_core import engine_preset

SOFT = replace(engine_preset(), scene=replace(engine_preset().scene, far_m=7.0))
"""


def install(site, distribution, name, target):
    source = (
        "from physic_core import PluginItem, hookimpl\n@hookimpl\ndef physic_engine_presets():\n"
    )
    site.install(distribution, f"{source}    return [PluginItem({name!r}, {target!r})]\n")


def test_an_energy_of_a_plugin_is_a_preset_with_settings_of_its_own(site):
    install(site, "physic-soft", "soft", "physic_soft_preset:SOFT")
    (site.folder / "physic_soft_preset.py").write_text(PRESET)
    assert "soft" in engine_preset_names()
    config = load_config(overrides=["engine.preset=soft", "engine.scene.carve_m=0.1"])
    settings = config.engine.settings()
    assert (settings.scene.far_m, settings.scene.carve_m) == (7.0, 0.1)
    assert settings.joint == engine_preset("default").joint


def test_an_energy_of_two_plugins_is_refused(site):
    for distribution in ("physic-one", "physic-two"):
        install(site, distribution, "twice", "physic_soft_preset:SOFT")
    with pytest.raises(
        ConfigError, match="'twice' is offered by physic-one and physic-two: uninstall one of them"
    ):
        load_config(overrides=["engine.preset=twice"])


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("physic_nowhere:SOFT", "physic-broken 1.0 cannot be imported"),
        ("math:pi", "EngineSettings, got float"),
    ],
)
def test_an_energy_that_is_no_settings_is_an_error_of_its_plugin(site, target, message):
    install(site, "physic-broken", "broken", target)
    with pytest.raises(PluginError, match=message):
        engine_preset("broken")


def test_an_energy_of_a_missing_distribution_names_it(monkeypatch):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-testing")
    done = CliRunner().invoke(
        main, ["config", "show", "--preset", "mock", "--set", "engine.preset=release"]
    )
    assert done.exit_code == 2
    assert (
        "the engine preset 'release' needs metricbody-paper, which is not installed, or hidden"
        in done.output
    )
    assert engine_preset_names() == ("default",)
