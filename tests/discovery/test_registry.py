from __future__ import annotations

import sys
from typing import Any

import pytest

from physic_core import interfaces
from physic_core.discovery.catalog import CATALOG
from physic_core.discovery.plugins import discover
from physic_core.discovery.registry import BackendOffer, BackendRecord, BrokenPlugin, Origin, Registry
from physic_core.errors import BackendError, BackendNotFoundError

A = Origin("a_plugin", "physic-a", "1.0")
B = Origin("b_plugin", "physic-b", "2.0")


class Blank(interfaces.Inpainter):
    def infer(self, image: Any, mask: Any) -> Any:
        return image


def registry(*claims: tuple[str, Origin], **kwargs: Any) -> Registry:
    return Registry(
        [BackendOffer(BackendRecord("inpainter", n, "m:C", api=1), origin) for n, origin in claims],
        installed=False,
        **kwargs,
    )


def message(error: type[Exception], call: Any, *args: Any) -> str:
    with pytest.raises(error) as caught:
        call(*args)
    return str(caught.value)


def test_a_registry_is_built_by_hand_with_a_class():
    own = Registry(installed=False)
    own.register(BackendRecord("inpainter", "blank", Blank, api=1))
    claim = own.get("inpainter", "blank")
    assert own.load_class(claim) is Blank
    assert str(claim) == "inpainter 'blank' (registered by hand)"
    assert own.names("inpainter") == ("blank",)
    assert own.names("segmenter") == ()


def test_a_registry_by_hand_adds_to_what_is_installed():
    own = Registry()
    own.register(BackendRecord("metric_depth", "mine", Blank, api=1))
    installed = [str(claim) for claim in discover()]
    assert [str(claim) for claim in own] == sorted([*installed, "metric_depth 'mine' (registered by hand)"])
    assert own.manifests == discover().manifests
    assert list(Registry(installed=False)) == []


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (
            BackendRecord("inpaint", "mine", Blank, api=1),
            "inpaint 'mine' (registered by hand) cannot be registered: no interface named 'inpaint'; "
            "did you mean 'inpainter'?",
        ),
        (
            BackendRecord("inpainter", "mine", Blank, api=2),
            "inpainter 'mine' (registered by hand) cannot be registered: "
            "written for version 2 of the interface inpainter, and this physic-core has version 1: upgrade physic-core",
        ),
    ],
)
def test_a_record_that_cannot_be_used_is_not_registered(record: BackendRecord, said: str):
    assert message(BackendError, Registry(installed=False).register, record) == said


def test_an_unknown_name_lists_installed_and_close_names_and_the_python():
    got = message(BackendNotFoundError, registry(("mock", A), ("telea", B)).get, "inpainter", "mok")
    assert got == f"no inpainter named 'mok'; installed: mock, telea. Did you mean 'mock'?\nPython: {sys.executable}"


def test_an_unknown_name_of_a_known_distribution_names_the_package_to_install():
    got = message(BackendNotFoundError, registry(("mock", A)).get, "inpainter", "telea")
    assert got == (
        "no inpainter named 'telea'; installed: mock. 'telea' comes with physic-opencv: "
        "`pip install -e plugins/physic-opencv` in a checkout of PhySIC\n"
        f"Python: {sys.executable}"
    )


def test_a_name_of_another_interface_is_reported():
    own = registry(("mock", A))
    own.register(BackendRecord("segmenter", "outline", "m:C", api=1), B)
    got = message(BackendNotFoundError, own.get, "inpainter", "outline")
    assert got == (f"no inpainter named 'outline'; installed: mock. 'outline' is a segmenter\nPython: {sys.executable}")


def test_a_missing_name_beside_a_broken_plugin_names_it_and_keeps_its_cause():
    cause = ModuleNotFoundError("No module named 'x'")
    broken = BrokenPlugin(Origin("c", "physic-c", "0.3"), "ModuleNotFoundError: No module named 'x'", cause)
    with pytest.raises(BackendNotFoundError) as caught:
        registry(("mock", A), broken=[broken]).get("inpainter", "fancy")
    assert str(caught.value) == (
        "no inpainter named 'fancy'; installed: mock. "
        "Broken plugins: physic-c 0.3 (ModuleNotFoundError: No module named 'x')\n"
        f"Python: {sys.executable}"
    )
    assert caught.value.__cause__ is cause


def test_a_restriction_is_mentioned_when_a_name_is_missing():
    got = message(BackendNotFoundError, registry(("mock", A), restriction="physic-a").get, "inpainter", "fancy")
    assert got == (
        "no inpainter named 'fancy'; installed: mock. "
        "PHYSIC_PLUGINS='physic-a' hides every other plugin: unset it, or add to it\n"
        f"Python: {sys.executable}"
    )


def test_two_claims_to_one_name_are_refused_and_both_are_named():
    got = message(BackendError, registry(("x", B), ("x", A)).get, "inpainter", "x")
    assert got == (
        "physic-a 1.0 and physic-b 2.0 each offer an inpainter named 'x': write 'physic-a:x' or 'physic-b:x' to choose"
    )


def test_a_name_registered_twice_by_one_distribution_differs_from_two_distributions():
    got = message(BackendError, registry(("x", A), ("x", A)).get, "inpainter", "x")
    assert got == "physic-a 1.0 offers an inpainter named 'x' 2 times: its author has to remove all but one"


@pytest.mark.parametrize("written", ["physic-b:x", "Physic_B:x"])
def test_distribution_and_name_choose_among_rivals(written: str):
    assert registry(("x", A), ("x", B)).get("inpainter", written).origin == B


def test_a_name_of_another_distribution_names_its_distribution():
    got = message(BackendNotFoundError, registry(("x", A), ("y", B)).get, "inpainter", "physic-b:x")
    assert got == f"no inpainter named 'physic-b:x'; installed: x, y. 'x' comes from physic-a\nPython: {sys.executable}"


def test_a_name_of_a_distribution_that_is_not_installed_names_the_package_to_install():
    own = registry(("embedded", A))
    got = message(BackendNotFoundError, own.get, "inpainter", "physic-embedded:embedded")
    assert got == (
        "no inpainter named 'physic-embedded:embedded'; installed: embedded. "
        "'embedded' comes with physic-embedded, which is not installed: "
        "`pip install -e plugins/physic-embedded` in a checkout of PhySIC\n"
        f"Python: {sys.executable}"
    )
    hidden = registry(("embedded", A), restriction="physic-a")
    assert message(BackendNotFoundError, hidden.get, "inpainter", "physic-embedded:embedded") == (
        "no inpainter named 'physic-embedded:embedded'; installed: embedded. "
        "PHYSIC_PLUGINS='physic-a' hides every other plugin: unset it, or add to it. "
        "'embedded' comes with physic-embedded: add physic-embedded to it, if need be after "
        f"`pip install -e plugins/physic-embedded` in a checkout of PhySIC\nPython: {sys.executable}"
    )
    misspelt = message(BackendNotFoundError, own.get, "inpainter", "physic-embeded:embedded")
    assert "Did you mean 'physic-embedded:embedded'?\n" in misspelt


def test_a_backend_with_a_problem_is_refused_with_it():
    claim = BackendOffer(BackendRecord("inpainter", "x", "m:C", api=1), A, "needs plugin API 2, this physic-core has 1")
    got = message(BackendError, Registry([claim], installed=False).get, "inpainter", "x")
    assert got == "inpainter 'x' (physic-a 1.0) cannot be used: needs plugin API 2, this physic-core has 1"


def test_a_target_in_a_config_works_without_packaging(site):
    (site.folder / "my_fill.py").write_text(
        "from physic_core.interfaces import Inpainter\n"
        "class Fill(Inpainter):\n"
        "    def infer(self, image, mask): return image\n"
    )
    own = Registry(installed=False)
    claim = own.get("inpainter", "my_fill:Fill")
    assert own.load_class(claim).__name__ == "Fill"
    assert str(claim) == "inpainter 'my_fill:Fill' (named in the config)"


def test_a_class_is_called_by_its_target_and_says_its_interface(site):
    (site.folder / "my_other_fill.py").write_text(
        "from physic_core.interfaces import Inpainter\n"
        "class Fill(Inpainter):\n"
        "    def infer(self, image, mask): return image\n"
    )
    (claim,) = registry(("telea", A)).find_by_name("my_other_fill:Fill")
    assert str(claim) == "inpainter 'my_other_fill:Fill' (a class that no plugin registers)"
    assert Registry(installed=False).load_concrete_class(claim).__name__ == "Fill"


def test_a_class_that_is_called_but_is_no_backend_is_refused():
    assert message(BackendError, Registry(installed=False).find_by_name, "no_such_module:C") == (
        "'no_such_module:C' cannot be imported: ModuleNotFoundError: No module named 'no_such_module'; "
        "put no_such_module.py beside the config, or its folder into PYTHONPATH"
    )
    for no_backend in ("json:dumps", "physic_core.interfaces:Backend"):
        assert message(BackendError, Registry(installed=False).find_by_name, no_backend) == (
            f"'{no_backend}' should be a subclass of one class of physic_core.interfaces: Segmenter, Inpainter, "
            "MetricDepth, RelativePointmap, KeypointDetector, BodyEstimator, HandEstimator, ContactPrior, CameraSolver"
        )


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        (
            "no_such_module:C",
            "ModuleNotFoundError: No module named 'no_such_module'; "
            "put no_such_module.py beside the config, or its folder into PYTHONPATH",
        ),
        ("json:Nothing", "AttributeError: module 'json' has no attribute 'Nothing'"),
    ],
)
def test_a_target_that_cannot_be_imported_keeps_its_cause(target: str, expected: str):
    own = Registry(installed=False)
    got = message(BackendError, own.load_class, own.get("inpainter", target))
    assert got == f"inpainter '{target}' (named in the config) cannot be imported from {target}: {expected}"


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import sys; sys.exit(3)", "SystemExit: 3 (my_failing_module.py:1)"),
        (
            "import no_such_module",
            "ModuleNotFoundError: No module named 'no_such_module' (my_failing_module.py:1)",
        ),
    ],
)
def test_a_target_whose_module_fails_names_its_distribution(tmp_path, monkeypatch, source: str, expected: str):
    (tmp_path / "my_failing_module.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    target, own = "my_failing_module:C", Registry(installed=False)
    got = message(BackendError, own.load_class, own.get("inpainter", target))
    assert got == f"inpainter '{target}' (named in the config) cannot be imported from {target}: {expected}"


def test_the_catalog_says_what_the_first_party_plugins_register():
    registered: dict[str, dict[str, tuple[str, ...]]] = {}
    for claim in discover():
        offers = registered.setdefault(claim.origin.distribution, {})
        offers[claim.record.interface] = (*offers.get(claim.record.interface, ()), claim.record.name)
    assert {k: registered[k] for k in CATALOG} == CATALOG
    assert list(CATALOG) == sorted(CATALOG)
