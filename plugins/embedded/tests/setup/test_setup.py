"""The command ``physic setup``: what it prints is what it runs, and it accepts no licence."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

import pytest

from physic_core import load_config
from physic_networks.checkouts import checkout_commit

PLUGIN = """
from pathlib import Path
from pydantic import Field
from physic_core import interfaces
from physic_core.interfaces import GpuMemory, Packages, Repository, UserFile

class Options(interfaces.Options):
    weights: str = Field(default="free-net", description="a set")
    checkout: str = Field(default="", description="a folder")
    body: str = Field(default="", description="a file")

class Depth(interfaces.MetricDepth):
    written_for = 1
    Options = Options
    def infer(self, image, hints): raise NotImplementedError
    def requirements(self):
        code, body = Path(self.options.checkout), Path(self.options.body)
        here = bool(self.options.checkout) and code.is_dir()
        return (
            Repository("checkout", "Thing", "URL", "COMMIT", self.options.checkout, is_here=here),
            Packages(("numpy", "no_such_package")),
            UserFile("body", "body.pkl", "register there", "https://there.org", 1000,
                     bool(self.options.body) and body.is_file()),
            GpuMemory(8, "its authors"),
        )
"""

MANIFEST = """
[free-net]
summary = "a free one"
license = "MIT"
commercial = true
[[free-net.files]]
path = "net.onnx"
bytes = 500
source = "https://example.org/net.onnx"

[other-net]
summary = "not for sale"
license = "CC-BY-NC-4.0"
commercial = false
homepage = "https://example.org/licence"
[[other-net.files]]
path = "net.onnx"
source = "https://example.org/other.onnx"
"""


@pytest.mark.parametrize("run", [(), ("--run",)])
def test_licences_sizes_and_what_was_not_measured_are_said_before_any_step(
    tmp_path, monkeypatch, run, physic
):
    monkeypatch.setattr("physic_setup.commands._run_step", lambda step: None)
    for name in ("PHYSIC_WEIGHTS", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    done = physic("setup", "open-body", "--folder", str(tmp_path), *run)
    first = done.stdout.partition("1. ")[0]
    assert all(
        word in first for word in ("RTMW3D", "MoGe-3 (1.48)", "MIT", "Apache-2.0", "Not measured")
    )
    assert run or "1.84 GB, and these, whose size is not published: rtmw3d-x" in first


@pytest.fixture
def thing(site, tmp_path, monkeypatch):
    """A plugin whose repository is a folder here; its commit."""
    origin = tmp_path / "origin" / "Thing"
    origin.mkdir(parents=True)
    (origin / "net.py").write_text("A = 1")

    def git(*words):
        who = ("-c", "user.name=a", "-c", "user.email=a@b")
        subprocess.run(["git", *who, *words], cwd=origin, check=True)

    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "one")
    commit = checkout_commit(origin)
    git("commit", "--allow-empty", "-qm", "two")
    entry = (
        "[physic.metric_depth]\nthing = physic_thing:Depth\n[physic.weights]\nthing = "
        "physic_thing_weights\n"
    )
    source = PLUGIN.replace("URL", str(origin)).replace("COMMIT", commit)
    site.install("physic-thing", source, entry=entry)
    (site.folder / "physic_thing_weights").mkdir()
    (site.folder / "physic_thing_weights" / "sets.toml").write_text(MANIFEST)
    monkeypatch.setenv("PYTHONPATH", str(site.folder), prepend=os.pathsep)
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "weights"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path, commit


def written(folder, **options):
    """A configuration that uses the plugin, as an earlier setup wrote it."""
    lines = [
        'extends = "embedded"',
        "[metric_depth]",
        'backend = "thing"',
        "[metric_depth.options]",
    ]
    (folder / "mine").mkdir(exist_ok=True)
    path = folder / "mine" / "embedded.toml"
    path.write_text("\n".join([*lines, *(f"{key} = '{value}'" for key, value in options.items())]))
    return path


def test_the_embedded_preset_needs_a_configuration_alone(tmp_path, monkeypatch, physic):
    monkeypatch.chdir(tmp_path)
    printed = physic("setup", "embedded", "--folder", "mine")
    assert printed.exit_code == 4
    assert "# Accounts: none" in printed.output.splitlines()
    assert list(tmp_path.iterdir()) == [], "printing writes nothing"
    done = physic("setup", "embedded", "--folder", "mine", "--run")
    assert (done.exit_code, "1 of 1 steps are done" in done.output) == (0, True)
    assert tomllib.loads((tmp_path / "mine" / "embedded.toml").read_text()) == {
        "extends": "embedded"
    }
    assert physic("setup", "embedded", "--folder", "mine").exit_code == 0
    link = tmp_path / "mine" / "embedded.toml"
    link.unlink()
    link.symlink_to(tmp_path / "not-mounted.toml")
    assert physic("setup", "embedded", "--folder", "mine", "--run").exit_code == 2
    assert link.is_symlink(), "a link of the user is not replaced"


def test_each_requirement_is_a_step_and_their_costs_are_added(thing, physic):
    folder, commit = thing
    written(folder)
    lines = physic("setup", "embedded", "--folder", "mine").output.splitlines()
    place = folder / "mine"
    for line, words in zip(
        lines, ("4 of 5 steps", "1.5 kB", "8 GB", "https://there.org", "1 of 2"), strict=False
    ):
        assert words in line
    assert any(
        line.startswith("python -m pip install") and line.endswith(" no_such_package")
        for line in lines
    )
    for line in (
        "physic weights fetch free-net",
        f"git clone {folder / 'origin' / 'Thing'} {place / 'Thing'}",
        f"git -C {place / 'Thing'} checkout --quiet {commit}",
        "#    by hand: register there",
        f"#    by hand: put it at {place / 'body.pkl'}",
    ):
        assert line in lines


def test_a_licence_that_restricts_use_is_left_to_the_user(thing, physic):
    written(thing[0], weights="other-net")
    lines = physic("setup", "embedded", "--folder", "mine").output.splitlines()
    assert "#    by hand: license: https://example.org/licence" in lines
    assert (
        "#    by hand: `physic weights fetch other-net --accept-license` (commercial use NOT "
        "allowed)" in lines
    )
    assert not any("accept" in line for line in lines if not line.startswith("#"))


def test_a_run_checks_out_the_tested_commit_and_stops_at_a_command_that_fails(
    thing,
):
    folder, commit = thing
    (folder / "weights" / "free-net").mkdir(parents=True)
    (folder / "weights" / "free-net" / "net.onnx").write_bytes(b"x" * 500)
    (folder / "mine").mkdir()
    (folder / "mine" / "body.pkl").write_bytes(b"")
    written(folder, checkout=str(folder / "mine" / "Thing"), body=str(folder / "mine" / "body.pkl"))
    site = folder / "site" / "physic_thing.py"
    site.write_text(site.read_text().replace("no_such_package", "scipy"))
    (folder / "origin").rename(folder / "away")
    command = [
        sys.executable,
        "-m",
        "physic_core",
        "setup",
        "embedded",
        "--folder",
        "mine",
        "--run",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "ended with code 128" in done.stderr
    (folder / "away").rename(folder / "origin")
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stdout + again.stderr
    assert checkout_commit(folder / "mine" / "Thing") == commit
    assert (
        f"   $ git -C {folder / 'mine' / 'Thing'} checkout --quiet {commit}"
        in again.stdout.splitlines()
    )


def test_the_open_preset_is_one_download_without_an_account_or_a_condition():
    from physic_core.configuration.resolve import named_weights, resolve
    from physic_core.interfaces import Repository, UserFile

    plan = resolve(load_config(preset="open"))
    sets = named_weights(plan)
    assert {weights.name for weights in sets} == {
        "sam2-hiera-tiny", "big-lama", "moge-3-vitl", "rtmw-l-384x288",
    }  # fmt: skip
    assert all(weights.is_free and all(file.sha256 for file in weights.files) for weights in sets)
    stated = {one for resolved in plan.backends.values() for one in resolved.backend.requirements()}
    assert not [one for one in stated if isinstance(one, UserFile)]
    (code,) = (one for one in stated if isinstance(one, Repository))
    assert (code.name, len(code.commit)) == ("MoGe-3", 40)


def test_a_package_without_commercial_use_is_left_to_the_user(physic):
    lines = physic("setup", "paper").stdout.splitlines()
    installs = [line for line in lines if line.startswith("python -m pip install")]
    assert installs
    assert not [line for line in installs if "smplx" in line.split()]
    assert (
        len(
            [
                line
                for line in lines
                if line.startswith("#    by hand: no commercial use: ") and "smplx" in line
            ]
        )
        == 1
    )
