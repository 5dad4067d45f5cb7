"""Backends of installed plugins: listed without an import, found by name, checked when they are
imported.
"""

from __future__ import annotations

import re
import sys

import pytest

from physic_core import find_backend, list_backends
from physic_core.discovery.backends import find_by_name, load_class
from physic_core.discovery.catalog import BACKENDS, PACKAGES
from physic_core.errors import (
    AmbiguousBackendError,
    BackendError,
    BackendNotFoundError,
    ConfigError,
)
from physic_core.interfaces import INTERFACES

pytestmark = pytest.mark.quick

FILL = (
    "from physic_core.interfaces import Inpainter\n"
    "class Fill(Inpainter):\n"
    "    def infer(self, image, mask): return image\n"
)


def message(kind, do, *arguments):
    with pytest.raises(kind) as caught:
        do(*arguments)
    return str(caught.value)


def load(interface, name):
    return load_class(find_backend(interface, name))


def test_an_offer_names_its_distribution_and_version(site):
    site.offer("physic-one", "inpainter", "one", version="1.2")
    offer = find_backend("inpainter", "one")
    assert (offer.interface, offer.target, offer.owner) == (
        "inpainter",
        "physic_one:B",
        "physic-one 1.2",
    )
    assert str(offer) == "inpainter 'one' (physic-one 1.2)"
    assert offer in list_backends()
    assert offer in list_backends("inpainter")
    assert offer not in list_backends("segmenter")
    assert "Did you mean 'inpainter'?" in message(ConfigError, list_backends, "inpaint")


def test_the_catalog_says_what_the_plugins_of_the_project_offer():
    offered = {offer.name: offer.distribution for offer in list_backends()}
    assert {name: owner for name, owner in BACKENDS.items() if owner in offered.values()} == offered
    packages = {
        re.split("[.:]", one.target, maxsplit=1)[0]: one.distribution for one in list_backends()
    }
    assert packages.items() <= PACKAGES.items()


# ---- a backend that is slow or broken costs only whoever uses it
# -----------------------------------------------------


PRINT_IMPORTED = """
import re
import sys
from physic_core.cli import main
try:
    main(sys.argv[1:])
finally:
    print('imported:', 'physic_slow' in sys.modules)
"""


def test_an_unused_backend_is_not_imported(site, python):
    source = f"raise SystemExit(3)\n{FILL}"
    site.install("physic-slow", source, entry="slow = physic_slow:Fill", group="physic.inpainter")
    for command in ("--help", "plugins", "config check --preset mock"):
        done = python(PRINT_IMPORTED, *command.split(), PYTHONPATH=str(site.folder))
        assert done.stdout.endswith("imported: False\n"), command


# ---- hostile backends are named when they are used
# -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("import sys; sys.exit(3)", ("cannot be imported", "SystemExit: 3 (physic_bad.py:1)")),
        (
            "raise RuntimeError('boom')",
            ("cannot be imported", "RuntimeError: boom (physic_bad.py:1)"),
        ),
        ("import no_such_module", ("'no_such_module' (physic_bad.py:1)",)),
        ("", ("AttributeError", "no attribute 'B'")),
        ("B = 3", ("is not a subclass of physic_core.interfaces.Inpainter",)),
        (
            "from physic_core.interfaces import MetricDepth as B",
            ("is not a subclass of physic_core.interfaces.Inp",),
        ),
        ("from physic_core.interfaces import Inpainter as B", ("has no method infer",)),
        (
            FILL.replace("Fill", "B").replace("image, mask", "image"),
            ("has infer(self, image), which should take image, mask",),
        ),
        (FILL.replace("Fill", "B"), ("written_for = 1",)),
        (
            FILL.replace("Fill", "B") + "    class Options: pass\n",
            ("has Options that are not a subclass of physic_core.interfaces.Options",),
        ),
        (
            FILL.replace("Fill", "B") + "    def __init__(self): pass\n",
            ("has __init__(self)", "super().__init__(options)"),
        ),
        (FILL.replace("Fill", "B") + "    reads = ('hole')\n", ('reads = ("hole",)',)),
    ],
    ids=[
        "exit",
        "raises",
        "needs",
        "no class",
        "no type",
        "interface",
        "abstract",
        "signature",
        "no version",
        "no options",
        "takes no options",
        "reads a text",
    ],
)
def test_a_hostile_backend_is_named_with_the_fault(site, source, words, physic):
    site.install("physic-bad", source, entry="bad = physic_bad:B", group="physic.inpainter")
    said = message(BackendError, load, "inpainter", "bad")
    assert said.startswith("inpainter 'bad' (physic-bad 1.0)")
    assert all(word in said for word in words), said
    listed = physic("plugins")
    assert (listed.exit_code, "physic-bad" in listed.stdout) == (0, True)
    shown = physic("plugins", "show", "bad")
    assert (shown.exit_code, words[-1] in shown.stdout) == (0, True)


@pytest.mark.parametrize(("api", "older"), [(0, "physic-new"), (2, "metricbody")])
def test_a_backend_for_another_version_of_its_interface_says_what_to_upgrade(site, api, older):
    site.offer("physic-new", "inpainter", "new", api=api)
    said = message(BackendError, load, "inpainter", "new")
    assert f"version {api} of the interface inpainter" in said
    assert said.endswith(f"upgrade {older}")


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_new_version_of_an_interface_refuses_the_backends_of_that_one_alone(
    site, monkeypatch, interface
):
    for other in INTERFACES:
        site.offer(f"third-party-{other.replace('_', '-')}", other, "theirs")
    monkeypatch.setattr(INTERFACES[interface], "api", INTERFACES[interface].api + 1)
    for other in INTERFACES:
        for name in ("mock", "theirs"):
            if other == interface:
                assert "upgrade" in message(BackendError, load, other, name)
            else:
                assert load(other, name)


def test_two_distributions_may_offer_one_name_and_the_user_chooses(site):
    site.offer("physic-b", "inpainter", "x")
    site.offer("physic-a", "inpainter", "x")
    said = message(AmbiguousBackendError, find_backend, "inpainter", "x")
    assert "'physic-a:x' or 'physic-b:x'" in said
    for written in ("physic-b:x", "Physic_B:x"):
        assert find_backend("inpainter", written).distribution == "physic-b"


# ---- names that are not there
# ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plugins", "name", "words"),
    [
        (None, "telae", ("installed: ", "Did you mean 'telea'?", sys.executable)),
        (
            "metricbody-testing",
            "telea",
            ("PHYSIC_PLUGINS='metricbody-testing' hides", "`pip install -e plugins/embedded`"),
        ),
        (None, "my-inpainter", ("pip install -e",)),
        (None, "wilor", ("'wilor' is the name of a hand_estimator",)),
        (None, "metricbody-onnx:telea", ("'telea' comes from metricbody-embedded",)),
        (
            "metricbody-testing",
            "metricbody-paper:lama",
            ("-e plugins/embedded -e plugins/paper`",),
        ),
        (None, "physic-embeded:embedded", ("'embedded' comes from metricbody-embedded",)),
    ],
)
def test_a_missing_name_says_what_there_is_and_where_it_comes_from(
    monkeypatch, plugins, name, words
):
    if plugins is not None:
        monkeypatch.setenv("PHYSIC_PLUGINS", plugins)
    said = message(BackendNotFoundError, find_backend, "inpainter", name)
    assert all(word in said for word in (f"'{name}'", *words)), said


# ---- classes that no plugin offers
# -----------------------------------------------------------------------------------


def test_a_class_is_named_without_packaging_and_says_its_interface(site):
    (site.folder / "my_fill.py").write_text(FILL)
    offer = find_backend("inpainter", "my_fill:Fill")
    assert load_class(offer).__name__ == "Fill"
    assert "my_fill:Fill" in str(offer)
    (found,) = find_by_name("my_fill:Fill")
    assert found == offer


def test_a_class_that_is_called_but_is_no_backend_is_refused():
    for no_backend in ("json:dumps", "physic_core.interfaces:Backend"):
        said = message(BackendError, find_by_name, no_backend)
        assert "should be a subclass" in said
        assert no_backend in said


@pytest.mark.parametrize(
    ("target", "source", "expected"),
    [
        ("no_such_module:C", "", "beside a config, only the module that it names is found"),
        ("json:Nothing", "", "no attribute 'Nothing'"),
        (
            "my_failing_module:C",
            "import sys; sys.exit(3)",
            "SystemExit: 3 (my_failing_module.py:1)",
        ),
        (
            "my_failing_module:C",
            "import no_such_module",
            "'no_such_module' (my_failing_module.py:1)",
        ),
    ],
)
def test_a_target_that_cannot_be_imported_names_the_cause(
    tmp_path, monkeypatch, target, source, expected
):
    (tmp_path / "my_failing_module.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    said = message(BackendError, load, "inpainter", target)
    assert target in said
    assert expected in said
