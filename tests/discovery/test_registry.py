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
        (BackendRecord("inpaint", "mine", Blank, api=1), "did you mean 'inpainter'?"),
        (BackendRecord("inpainter", "mine", Blank, api=2), "upgrade physic-core"),
    ],
)
def test_a_record_that_cannot_be_used_is_not_registered(record: BackendRecord, said: str):
    assert said in message(BackendError, Registry(installed=False).register, record)


def test_an_unknown_name_lists_installed_and_close_names_and_the_python():
    got = message(BackendNotFoundError, registry(("mock", A), ("telea", B)).get, "inpainter", "mok")
    assert "installed: mock, telea. Did you mean 'mock'?" in got
    assert sys.executable in got


def test_an_unknown_name_of_a_known_distribution_names_the_package_to_install():
    got = message(BackendNotFoundError, registry(("mock", A)).get, "inpainter", "telea")
    assert "'telea' comes with physic-opencv: `pip install" in got


def test_a_name_of_another_interface_is_reported():
    own = registry(("mock", A))
    own.register(BackendRecord("segmenter", "outline", "m:C", api=1), B)
    assert "'outline' is a segmenter" in message(BackendNotFoundError, own.get, "inpainter", "outline")


def test_a_missing_name_beside_a_broken_plugin_names_it_and_keeps_its_cause():
    cause = ModuleNotFoundError("No module named 'x'")
    broken = BrokenPlugin(Origin("c", "physic-c", "0.3"), "ModuleNotFoundError: No module named 'x'", cause)
    with pytest.raises(BackendNotFoundError, match=r"Broken plugins: physic-c 0\.3") as caught:
        registry(("mock", A), broken=[broken]).get("inpainter", "fancy")
    assert caught.value.__cause__ is cause


def test_a_restriction_is_mentioned_when_a_name_is_missing():
    got = message(BackendNotFoundError, registry(("mock", A), restriction="physic-a").get, "inpainter", "fancy")
    assert "PHYSIC_PLUGINS='physic-a' hides every other plugin" in got


def test_two_claims_to_one_name_are_refused_and_both_are_named():
    got = message(BackendError, registry(("x", B), ("x", A)).get, "inpainter", "x")
    assert "write 'physic-a:x' or 'physic-b:x' to choose" in got


def test_a_name_registered_twice_by_one_distribution_differs_from_two_distributions():
    got = message(BackendError, registry(("x", A), ("x", A)).get, "inpainter", "x")
    assert "physic-a 1.0 offers an inpainter named 'x' 2 times" in got


@pytest.mark.parametrize("written", ["physic-b:x", "Physic_B:x"])
def test_distribution_and_name_choose_among_rivals(written: str):
    assert registry(("x", A), ("x", B)).get("inpainter", written).origin == B


def test_a_name_of_another_distribution_names_its_distribution():
    got = message(BackendNotFoundError, registry(("x", A), ("y", B)).get, "inpainter", "physic-b:x")
    assert "'x' comes from physic-a" in got


def test_a_name_of_a_distribution_that_is_not_installed_names_the_package_to_install():
    own, hidden = registry(("embedded", A)), registry(("embedded", A), restriction="physic-a")
    for found in (own, hidden):
        got = message(BackendNotFoundError, found.get, "inpainter", "physic-embedded:embedded")
        assert "'embedded' comes with physic-embedded" in got
        assert "`pip install -e plugins/physic-embedded`" in got
    misspelt = message(BackendNotFoundError, own.get, "inpainter", "physic-embeded:embedded")
    assert "Did you mean 'physic-embedded:embedded'?" in misspelt


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
    missing = message(BackendError, Registry(installed=False).find_by_name, "no_such_module:C")
    assert "put no_such_module.py beside the config" in missing
    for no_backend in ("json:dumps", "physic_core.interfaces:Backend"):
        said = message(BackendError, Registry(installed=False).find_by_name, no_backend)
        assert "should be a subclass of one class of physic_core.interfaces: Segmenter, Inpainter" in said


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("no_such_module:C", "put no_such_module.py beside the config, or its folder into PYTHONPATH"),
        ("json:Nothing", "module 'json' has no attribute 'Nothing'"),
    ],
)
def test_a_target_that_cannot_be_imported_keeps_its_cause(target: str, expected: str):
    own = Registry(installed=False)
    assert expected in message(BackendError, own.load_class, own.get("inpainter", target))


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import sys; sys.exit(3)", "SystemExit: 3 (my_failing_module.py:1)"),
        ("import no_such_module", "'no_such_module' (my_failing_module.py:1)"),
    ],
)
def test_a_target_whose_module_fails_names_its_line(tmp_path, monkeypatch, source: str, expected: str):
    (tmp_path / "my_failing_module.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    own = Registry(installed=False)
    assert expected in message(BackendError, own.load_class, own.get("inpainter", "my_failing_module:C"))


def test_the_catalog_says_what_the_first_party_plugins_register():
    registered: dict[str, dict[str, tuple[str, ...]]] = {}
    for claim in discover():
        offers = registered.setdefault(claim.origin.distribution, {})
        offers[claim.record.interface] = (*offers.get(claim.record.interface, ()), claim.record.name)
    assert {k: registered[k] for k in CATALOG} == CATALOG
    assert list(CATALOG) == sorted(CATALOG)
