"""Commands that plugins add to ``physic`` and to ``physic plugins``."""

from __future__ import annotations

import re

import pytest

from physic_core.discovery.catalog import COMMANDS, how_to_install

PLUGIN = """
from physic_core import PluginItem, hookimpl

@hookimpl
def physic_commands():
    return [
        PluginItem("hello", "physic_hello_commands:hello", "Greet."),
        PluginItem("plugins hello", "physic_hello_commands:hello", "Greet the plugins."),
        PluginItem("run", "physic_hello_commands:hello", "Not this one."),
        PluginItem("absent", "physic_hello_commands:absent"),
        PluginItem("lost", "physic_hello_nowhere:lost"),
        PluginItem("number", "physic_hello_commands:number"),
    ]
"""
COMMAND = """
import click

@click.command()
@click.option("--name", default="you")
def hello(name):
    click.echo(f"hello {name}")

number = 3
"""


@pytest.fixture
def plugin(site):
    site.install("physic-hello", PLUGIN)
    (site.folder / "physic_hello_commands.py").write_text(COMMAND)
    return site


@pytest.mark.parametrize("group", [(), ("plugins",)], ids=str)
def test_a_plugin_adds_a_command(plugin, group, physic):
    done = physic(*group, "hello", "--name", "world")
    assert (done.exit_code, done.output) == (0, "hello world\n")
    summary = "Greet the plugins." if group else "Greet."
    assert re.search(rf"^  hello +{summary}$", physic(*group, "--help").output, re.M)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lost", "the command 'lost' of physic-hello 1.0 cannot be imported: ModuleNotFoundError"),
        ("absent", "the command 'absent' of physic-hello 1.0 cannot be imported: AttributeError"),
        ("number", "the command 'number' of physic-hello 1.0 should be a click.Command"),
    ],
)
def test_a_broken_command_is_an_error_of_the_plugin_and_breaks_no_other(
    plugin, name, message, physic
):
    done = physic(name)
    assert (done.exit_code, done.stdout, message in done.stderr) == (5, "", True)
    assert physic("hello").exit_code == 0
    assert physic("--help").exit_code == 0


HELP = """
import sys
from physic_core.cli import main
main(sys.argv[1:], standalone_mode=False)
banned = {'torch', 'numpy', 'pydantic', 'physic_hello_commands', 'physic_core.cli.commands.run'}
print('imported:', sorted(banned & set(sys.modules)))
"""


def test_help_imports_no_command(plugin, python):
    (plugin.folder / "physic_hello_commands.py").write_text("raise SystemExit('imported')")
    for arguments in (["--help"], ["plugins", "--help"]):
        shown = python(HELP, *arguments, PYTHONPATH=str(plugin.folder)).stdout
        assert "hello" in shown
        assert shown.endswith("imported: []\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_known_command_that_is_not_installed_names_its_distribution(name, monkeypatch, physic):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-onnx")
    done = physic(*name.split())
    assert done.exit_code == 2
    error = " ".join(done.stderr.split())
    assert (
        f"Error: 'physic {name}' is a command of {COMMANDS[name]}, which is not installed, or "
        f"hidden" in error
    )
    assert error.endswith(how_to_install(COMMANDS[name]))
    assert (
        how_to_install("metricbody-testing")
        == "`pip install -e plugins/testing` in a checkout of PhySIC"
    )
