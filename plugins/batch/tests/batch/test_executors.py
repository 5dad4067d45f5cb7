"""Executors of ``physic batch``: the core finds those of plugins by name, and names none itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from physic_batch.run import ExecutorSettings, open_executor
from physic_core.cli import main
from physic_core.errors import PluginError

EXECUTOR = """
from physic_core import PluginItem, hookimpl
from physic_batch.photo_processor import failed_row
from physic_core.errors import ConfigError

def queue_executor(settings):
    if settings.options.keys() - {"reason"}:
        raise ConfigError("the executor 'queue' has no such setting; it has reason")

    def run(items, job):
        reason = f"{settings.options.get('reason')} at {settings.address}, {settings.workers} workers"
        for item in items:
            yield failed_row(job, item, "Queued", reason, 0.0)

    return run

def number(settings):
    return 3

@hookimpl
def physic_executors():
    return [
        PluginItem("queue", "physic_queue:queue_executor"),
        PluginItem("lost", "physic_queue_nowhere:lost"),
        PluginItem("number", "physic_queue:number"),
    ]
"""  # noqa: E501


def physic(*arguments):
    return CliRunner().invoke(
        main, ["batch", "photos", "-o", "out", "--preset", "mock", *arguments]
    )


@pytest.fixture
def photos(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").write_text("a")
    return tmp_path / "photos"


@pytest.fixture
def plugin(site):
    site.install("physic-queue", EXECUTOR)
    return site


def test_a_plugin_adds_an_executor(plugin, photos):
    options = (
        "--executor",
        "queue",
        "--address",
        "here",
        "--workers",
        "3",
        "--executor-set",
        "reason = full",
    )
    done = physic(*options)
    assert (done.exit_code, done.stdout.splitlines()[0]) == (0, "0 done, 1 failed (1 Queued)")
    assert "Queued: full at here, 3 workers" in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--executor", "queue", "--executor-set", "x=1"), "no such setting; it has reason"),
        (("--executor", "local", "--address", "auto"), "--address is for clusters"),
        (("--executor-set", "cpus=2"), "--executor-set is for clusters"),
    ],
)
def test_settings_that_an_executor_does_not_have(plugin, photos, options, words):
    done = physic(*options)
    assert (done.exit_code, words in done.stderr) == (2, True)
    assert not Path("out").exists()


@pytest.mark.parametrize(("name", "words"), [("slurm", "--shard"), ("ray", "needs metricbody-ray")])
def test_a_name_that_is_not_installed_is_explained(monkeypatch, photos, name, words):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-batch,metricbody-testing")
    done = physic("--executor", name)
    assert (done.exit_code, words in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("name", "fault"), [("lost", "ModuleNotFoundError"), ("number", "got int")]
)
def test_a_broken_executor_names_its_plugin(plugin, name, fault):
    with pytest.raises(PluginError, match=f"'{name}' .*{fault}"):
        open_executor(name, ExecutorSettings())
