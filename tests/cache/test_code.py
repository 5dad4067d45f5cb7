"""Which code a class is: every edit counts, and code that nobody can name has no digest."""

from __future__ import annotations

import importlib
import os
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path
from zipfile import ZipFile

import pytest

from physic_core.cache import digests
from physic_core.cache.digests import CodeDigester
from physic_core.cache.kit_stamps import has_passed_kit, remember_passed, target_of
from physic_core.interfaces import MetricDepth

pytestmark = pytest.mark.quick


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder to import from; its files count as older than this process."""
    monkeypatch.setattr(digests, "_STARTED", float("inf"))
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


SOURCE = "class Depth:\n    answer = 1\n"


def package(site):
    write(site / "pack" / "__init__.py", "")
    write(site / "pack" / "deep" / "__init__.py", "")
    write(site / "pack" / "other.py", "x = 1\n")
    write(site / "pack" / "weights.onnx", "12345")
    write(site / "pack" / "deep" / "worker.py", SOURCE)
    importlib.invalidate_caches()
    kind = importlib.import_module("pack.deep.worker").Depth
    return kind


def test_the_same_files_have_one_digest(site):
    kind = package(site)
    first = CodeDigester().digest(kind)
    assert first is not None
    write(site / "pack" / "__pycache__" / "other.pyc", "x")
    write(site / "beside.py", "x")
    assert CodeDigester().digest(kind) == first


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no pipes")
def test_a_pipe_and_a_link_to_nothing_are_no_code(site):
    kind = package(site)
    first = CodeDigester().digest(kind)
    os.mkfifo(site / "pack" / "pipe.py")
    (site / "pack" / ".#other.py").symlink_to("user@machine.1234")
    assert CodeDigester().digest(kind) == first


def test_a_name_that_is_not_utf8_counts_and_code_that_is_gone_or_in_an_archive_has_no_digest(site):
    kind = package(site)
    first = CodeDigester().digest(kind)
    with suppress(OSError):  # a file system that refuses it
        Path(os.fsdecode(os.fsencode(site / "pack") + b"/\xff.bin")).touch()
        assert CodeDigester().digest(kind) not in (first, None)
    with ZipFile(site / "packed.zip", "w") as archive:
        archive.writestr("packed.py", SOURCE)
    sys.path.insert(0, str(site / "packed.zip"))
    packed = importlib.import_module("packed").Depth
    sys.path.remove(str(site / "packed.zip"))
    shutil.rmtree(site / "pack")
    assert CodeDigester().digest(packed) is CodeDigester().digest(kind) is None


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("pack/deep/worker.py", SOURCE.replace("1", "2")),
        ("pack/other.py", "x = 2\n"),
        ("pack/__init__.py", "#"),
        ("pack/weights.onnx", "123456"),
        ("pack/new.py", ""),
    ],
)
def test_every_edit_of_the_package_counts(site, file, text):
    kind = package(site)
    first = CodeDigester().digest(kind)
    write(site / file, text)
    assert CodeDigester().digest(kind) not in (first, None)


STANDING = {
    "a module beside one in no package": (
        {"my_depth.py": SOURCE},
        "my_depth",
        ("my_helpers.py", "x = 1\n"),
    ),
    "a base class": (
        {
            "base.py": SOURCE,
            "pack/__init__.py": "from base import Depth as D\nclass Depth(D): ...\n",
        },
        "pack",
        ("base.py", SOURCE.replace("1", "2")),
    ),
    "a package that is not installed": (
        {
            "acme_models/__init__.py": "x = 1\n",
            "pack/__init__.py": f"{SOURCE}    def infer(self):\n        import os, acme_models.x\n",
        },
        "pack",
        ("acme_models/__init__.py", "x = 2\n"),
    ),
    "a package without __init__.py that is not installed": (
        {
            "acme_ns/deep/net.py": "x = 1\n",
            "pack/__init__.py": f"from acme_ns.deep.net import x\n{SOURCE}",
        },
        "pack",
        ("acme_ns/deep/net.py", "x = 2\n"),
    ),
    "a compiled module beside one in no package": (
        {"my_depth.py": SOURCE, "my_kernels.so": "1"},
        "my_depth",
        ("my_kernels.so", "12"),
    ),
    "a file that the text of a module in no package names": (
        {
            "my_depth.py": f"{SOURCE}    def infer(self):\n        open('lens/scale.json')\n",
            "lens/scale.json": "1",
        },
        "my_depth",
        ("lens/scale.json", "2"),
    ),
    "a file in a folder that the text of a module in no package names": (
        {
            "my_depth.py": f"from pathlib import Path\n{SOURCE}    here = Path('lens') / 'scale'\n",
            "lens/scale": "1",
        },
        "my_depth",
        ("lens/scale", "2"),
    ),
    "a package around a folder without __init__.py": (
        {"pack/__init__.py": "", "pack/net.py": "x = 1\n", "pack/deep/depth.py": SOURCE},
        "pack.deep.depth",
        ("pack/net.py", "x = 2\n"),
    ),
    "a package of many files": (
        {f"pack/part_{n}.txt": "" for n in range(2001)}
        | {"pack/__init__.py": SOURCE, "pack/weights.bin": "1"},
        "pack",
        ("pack/weights.bin", "12"),
    ),
    **{
        f"a package of the statement {statement!r}": (
            {
                "acme_models/__init__.py": "x = 1\n",
                "acme_models/deep.py": "",
                "pack/__init__.py": f"{statement}\n{SOURCE}",
            },
            "pack",
            ("acme_models/__init__.py", "x = 2\n"),
        )
        for statement in (
            "try: import acme_models\nexcept ImportError: pass",
            "import os; from acme_models import x",
            "import os, \\\n    acme_models",
            "import importlib\nm = importlib.import_module(\n    'acme_models.deep'\n)",
            "from importlib import import_module as load\nm = load('acme_models')",
            "m = __import__('acme_models')",
            "try:\n    from\\\n\t\tacme_models import x\nexcept ImportError: pass",
        )
    },
    "a package that it stands on": (
        {
            "physic_base/__init__.py": "from physic_ground import x",
            "physic_ground/__init__.py": "from physic_base import y",
            "pack/__init__.py": f"{SOURCE}    def infer(self):\n        import physic_base\n",
        },
        "pack",
        ("physic_ground/__init__.py", "x = 2"),
    ),
}


@pytest.mark.parametrize("name", STANDING)
def test_an_edit_outside_of_the_own_package_counts(site, name):
    files, module, edit = STANDING[name]
    for path, text in files.items():
        write(site / path, text)
    importlib.invalidate_caches()
    kind = importlib.import_module(module).Depth
    first = CodeDigester().digest(kind)
    write(site / edit[0], edit[1])
    assert None not in (first, second := CodeDigester().digest(kind))
    assert first != second


def test_of_an_installed_package_the_version_counts_and_the_files_if_it_is_of_no_index(
    site, monkeypatch
):
    installed = site / "site-packages"
    about = write(installed / "acme_models-1.dist-info" / "METADATA", "Name: x-acme\nVersion: 1\n")
    write(about.with_name("top_level.txt"), "acme_models")
    module = write(installed / "acme_models" / "__init__.py", "")
    write(site / "pack" / "__init__.py", f"import acme_models\n{SOURCE}")
    monkeypatch.syspath_prepend(str(installed))
    kind = importlib.import_module("pack").Depth
    first = CodeDigester().digest(kind)
    write(module, "x = 2\n")
    assert CodeDigester().digest(kind) == first
    about.parent.rename(installed / "acme_models-2.dist-info")
    second = write(installed / "acme_models-2.dist-info" / "METADATA", "Name: x-acme\nVersion: 2\n")
    assert CodeDigester().digest(kind) not in (first, None)
    write(second.with_name("direct_url.json"), '{"url": "file:///home/me/acme", "dir_info": {}}')
    seen = set()
    for sha256 in ("1", "2"):  # an author installs the folder again, and keeps the version
        write(second.with_name("RECORD"), f"acme_models/__init__.py,sha256={sha256},6")
        os.utime(installed, (0, len(seen)))
        seen.add(CodeDigester().digest(kind))
    assert len(seen) == 2


def test_a_module_edited_after_the_start_has_no_digest(site, monkeypatch):
    kind = package(site)
    monkeypatch.setattr(digests, "_STARTED", time.time() - 100)
    assert CodeDigester().digest(kind) is None
    for path in (site / "pack").rglob("*.py"):
        os.utime(path, (time.time() - 200,) * 2)
    assert CodeDigester().digest(kind) is not None
    # A clock that was wrong once says nothing.
    os.utime(site / "pack" / "other.py", (time.time() + 1e6,) * 2)
    assert CodeDigester().digest(kind) is not None


def test_a_class_of_a_function_or_of_a_session_has_no_digest(monkeypatch):
    class Local(MetricDepth):
        def infer(self, image, hints): ...

    assert CodeDigester().digest(Local) is None
    monkeypatch.setattr(MetricDepth, "__module__", "__main__")
    assert CodeDigester().digest(MetricDepth) is None
    monkeypatch.setattr(MetricDepth, "__module__", "no.such.module")
    assert CodeDigester().digest(MetricDepth) is None


OPTIONS = """from pathlib import Path
from physic_core.interfaces import MetricDepth
import acme_models
class Depth(MetricDepth):
    class Options(MetricDepth.Options):
        factor: float = 1.0
        file: str = ""
        folder: str = ""
    def infer(self, image, hints): ...
    def fingerprint(self): return Path(__file__).with_name("fingerprint").read_text()
"""


def test_a_backend_has_passed_kit_until_what_its_results_depend_on_changes(site, monkeypatch):
    monkeypatch.setenv("PHYSIC_CACHE", str(site / "cache"))
    named = write(site / "weights.bin", "1")
    inside = write(site / "elsewhere" / "part.bin", "1")
    (site / "weights").mkdir()
    (site / "weights" / "deep").symlink_to(inside.parent)
    (site / "weights" / "loop").symlink_to(site / "weights")
    (site / "weights" / "lost").symlink_to("nowhere")
    monkeypatch.chdir(site)
    write(site / "acme_models" / "__init__.py", "")
    write(site / "pack" / "fingerprint", "1")
    write(site / "pack" / "__init__.py", OPTIONS)
    importlib.invalidate_caches()
    kind = importlib.import_module("pack").Depth
    asked = "metric_depth", target_of(kind)

    def backend(**options):
        places = {"file": str(named), "folder": "weights"}
        return kind(kind.Options(**places, **options))

    assert not has_passed_kit(*asked)
    remember_passed("metric_depth", backend())
    assert has_passed_kit(*asked)
    assert has_passed_kit(*asked, backend())
    assert not has_passed_kit("inpainter", *asked[1:], backend())
    assert not has_passed_kit(*asked, backend(factor=2.0))
    for path in (named, site / "acme_models" / "__init__.py", site / "pack" / "fingerprint"):
        text = path.read_text()
        write(path, "#2")
        assert not has_passed_kit(*asked, backend())
        write(path, text)
        assert has_passed_kit(*asked, backend())
    write(inside, "12")
    assert not has_passed_kit(*asked, backend())
