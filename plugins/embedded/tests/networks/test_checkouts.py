"""Importing the user's checkouts without touching anything else."""

from __future__ import annotations

import os
import sys

import pytest

from physic_core.errors import BackendError, WeightsMissingError
from physic_networks.checkouts import Checkout


def checkout(folder, files, package="core.net", **settings):
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Checkout(
        str(folder), name="Thing", package=package, homepage="https://example.org/thing", **settings
    )


def test_two_checkouts_with_packages_of_one_name_do_not_meet(tmp_path):
    lazy = "def late():\n    from utils.deep import WORD\n    return WORD\n"
    one, two = (
        checkout(
            tmp_path / word,
            {
                "core/net.py": f"import utils\nfrom utils.deep import WORD\n{lazy}",
                "utils/__init__.py": "",
                "utils/deep.py": f"WORD = '{word}'",
            },
        )
        for word in ("first", "second")
    )
    nets = [one.load(), two.load()]
    assert [net.WORD for net in nets] == ["first", "second"]
    for side, net in zip((one, two, one), (nets[0], nets[1], nets[0]), strict=True):
        with side.activated():
            assert net.late() == net.WORD


def test_a_checkout_leaves_no_module_and_no_path_behind(tmp_path):
    path = list(sys.path)
    modules = set(sys.modules)
    side = checkout(tmp_path, {"core/net.py": "import json, utils", "utils.py": "A = 1"})
    side.load()
    assert sys.path == path
    assert not {name.partition(".")[0] for name in set(sys.modules) - modules} & {"core", "utils"}


def test_an_import_error_of_a_checkout_restores_the_import_path(tmp_path):
    path = list(sys.path)
    side = checkout(tmp_path, {"core/net.py": "raise RuntimeError('no such GPU')"})
    said = (
        f"Thing in {tmp_path} cannot be imported: RuntimeError: no such GPU; try its own demo "
        f"in this environment"
    )
    with pytest.raises(BackendError, match=said):
        side.load()
    assert sys.path == path
    assert "core" not in sys.modules


def test_a_wrong_folder_is_reported_before_anything_is_imported(tmp_path):
    page = "https://example.org/thing"
    absent = Checkout(str(tmp_path / "no"), name="Thing", package="core.net", homepage=page)
    other = checkout(tmp_path, {"setup.py": ""})
    none = Checkout(
        "", name="Thing", package="thing_that_nobody_installed.net", homepage=page, commit="c0ffee"
    )
    for side, words in (
        (absent, f"there is no folder {tmp_path / 'no'}"),
        (other, f"{tmp_path} is not a checkout of Thing, since it has no core/net.py"),
        (none, f"(git clone {page} && git -C thing checkout c0ffee)"),
    ):
        (said,) = side.missing()
        assert words in said
        with pytest.raises(WeightsMissingError, match=r"checkout of https://example\.org/thing"):
            side.load()


FILES = {
    "core/net.py": "A = 1.0",
    "core/configs/net.json": "[1.0]",
    "core/net.toml": "a = 1.0",
    "other/tool.py": "A = 1.0",
    "tool.py": "A = 1.0",
    "configs/deep/net.yaml": "a: 1.0",
    "net.yml": "a: 1.0",
}


@pytest.mark.parametrize("name", FILES)
def test_one_number_changes_the_fingerprint(tmp_path, name):
    side = checkout(tmp_path, FILES)
    before = side.fingerprint()
    time = (tmp_path / name).stat().st_mtime_ns
    (tmp_path / name).write_text(FILES[name].replace("1.0", "2.0"))
    os.utime(tmp_path / name, ns=(time, time))
    assert side.fingerprint() != before


def test_data_and_environments_are_not_in_the_fingerprint(tmp_path):
    side = checkout(tmp_path, FILES)
    before = side.fingerprint()
    others = {"data/labels.json": "0" * 1_000_000, "weights.bin": "0", ".git/hook.py": "0"}
    others |= {
        "env/pyvenv.cfg": "0",
        "env/lib/site.py": "0",
        "conda/conda-meta/a.json": "0",
        "conda/lib/site.py": "0",
    }
    checkout(tmp_path, others)
    assert side.fingerprint() == before


def test_loaded_code_keeps_its_fingerprint_until_it_is_closed(tmp_path):
    side = checkout(tmp_path, FILES)
    before = side.fingerprint()
    side.load()
    (tmp_path / "core" / "net.py").write_text("A = 2.0")
    assert side.fingerprint() == before
    side.close()
    assert side.fingerprint() != before
