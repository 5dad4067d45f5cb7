"""The command ``physic weights``."""

from __future__ import annotations

import hashlib
import re

import pytest

from .conftest import CONTENT, HASH, write

pytestmark = pytest.mark.quick


def manifest(url):
    return f"""
[free]
summary = "A free network"
license = "MIT"
commercial = true
homepage = "https://example.org/free"
[[free.files]]
path = "free.onnx"
bytes = {len(CONTENT)}
sha256 = "{HASH}"
source = "{url}"

[gated]
summary = "A gated network"
license = "Own licence: research only"
commercial = false
account = true
homepage = "https://example.org/gated"
[[gated.files]]
path = "gated.onnx"
source = "hf://owner/gated/gated.onnx"

[own]
summary = "A network of your own"
license = "CC-BY-4.0"
advice = "export it with tools/export_own.py"
[[own.files]]
path = "own.onnx"
[[own.files]]
path = "own.json"
"""


@pytest.fixture
def plugin(site, server, monkeypatch):
    """One plugin with three sets, one of which the server has."""
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-nets,metricbody-embedded")
    site.list_weights("physic-nets", manifest(server.add("/free.onnx", CONTENT)))
    return site


def test_the_list_shows_size_licence_and_state_of_each_weight_set(plugin, own_cache, physic):
    write(own_cache / "own" / "own.json", b"{}")
    free, gated, own = (
        re.split(r"  +", line) for line in physic("weights", "list").stdout.splitlines()[1:]
    )
    assert free == ["free", "physic-nets", "1.05 MB", "yes", "-", "missing", "MIT"]
    assert gated[3:] == ["NO", "needed", "missing", "Own licence: research only"]
    assert own[3:] == ["not stated", "-", "in part", "CC-BY-4.0"]
    write(own_cache / "free" / "free.onnx", CONTENT)
    assert physic("weights", "list").stdout.splitlines()[1].split()[6] == "here"
    _, *rows = physic("weights", "list", "--missing").stdout.splitlines()
    assert [row.split()[0] for row in rows] == ["gated", "own"]
    write(own_cache / "free" / "free.onnx", b"cut off")
    assert "here, DIFFERS  MIT" in physic("weights", "list").stdout


def test_a_broken_list_is_a_row_and_named_where_a_set_is_not_found(plugin, monkeypatch, physic):
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-nets,physic-odd,metricbody-embedded")
    plugin.list_weights("physic-odd", "[odd]\nsummary = 'x'\nlicense = 'MIT'\nfiles = []\n")
    assert re.search(r"physic-odd .*BROKEN.*\[odd\]", physic("weights", "list").stdout)
    done = physic("weights", "verify", "nothing")
    assert done.exit_code == 2
    assert re.search(r"'nothing'.*physic-odd 1\.0", done.stderr, re.DOTALL)


def test_fetch_goes_on_with_the_others(plugin, own_cache, physic):
    done = physic("weights", "fetch", "own", "gated", "free")
    assert (done.exit_code, str(own_cache / "free" / "free.onnx") in done.stdout) == (4, True)
    assert f"tools/export_own.py; then copy it into {own_cache / 'own'}" in done.stderr
    assert "Own licence: research only" in done.stderr
    assert "physic weights fetch gated --accept-license" in done.stderr


def test_a_fetched_folder_is_read_offline_by_another_machine(
    plugin, tmp_path, server, monkeypatch, physic
):
    stick = tmp_path / "stick"
    done = physic("weights", "fetch", "free", "--to", str(stick))
    assert (done.exit_code, str(stick / "free") in done.stdout) == (0, True)
    assert "1.05 MB" in done.stderr
    server.close()
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(stick))
    assert physic("weights", "verify").exit_code == 0
    done = physic("weights", "fetch", "free")
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"already in {stick / 'free' / 'free.onnx'}" in done.stdout


def test_verify_lists_what_differs_and_what_has_no_published_hash(plugin, own_cache, physic):
    write(own_cache / "free" / "free.onnx", CONTENT[::-1])
    write(own_cache / "own" / "own.json", b"{}")
    done = physic("weights", "verify")
    assert done.exit_code == 4
    assert re.search(
        rf"DIFFERS.* {hashlib.sha256(CONTENT[::-1]).hexdigest()} .*{HASH}", done.stdout
    )
    assert re.search(r"ok .*own\.json.*no SHA-256", done.stdout)
    done = physic("weights", "verify", "own")
    assert [line.split()[0] for line in done.stdout.splitlines()[:2]] == ["missing", "ok"]
    assert done.exit_code == 4
    write(own_cache / "free" / "free.onnx", b"cut off")
    assert f"7 bytes instead of {len(CONTENT)}" in physic("weights", "verify", "free").stdout
