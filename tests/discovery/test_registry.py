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
        (BackendRecord("inpainter", "mine", Blank, api=2), "version 2 of the interface inpainter"),
    ],
)
def test_a_record_that_cannot_be_used_is_not_registered(record: BackendRecord, said: str):
    assert said in message(BackendError, Registry(installed=False).register, record)


def with_segmenter(name: str) -> Registry:
    own = registry(("mock", A))
    own.register(BackendRecord("segmenter", name, "m:C", api=1), B)
    return own


@pytest.mark.parametrize(
    ("own", "name", "words"),
    [
        (registry(("mock", A), ("telea", B)), "mok", ("mock, telea", "Did you mean 'mock'?", sys.executable)),
        (registry(("mock", A)), "telea", ("`pip install -e plugins/physic-opencv`",)),
        (with_segmenter("outline"), "outline", ("'outline' is a segmenter",)),
        (registry(("mock", A), restriction="physic-a"), "fancy", ("PHYSIC_PLUGINS='physic-a' hides",)),
        (registry(("x", A), ("y", B)), "physic-b:x", ("'x' comes from physic-a",)),
        (registry(("embedded", A)), "physic-embedded:embedded", ("`pip install -e plugins/physic-embedded`",)),
        (
            registry(("embedded", A), restriction="physic-a"),
            "physic-embedded:embedded",
            ("PHYSIC_PLUGINS='physic-a' hides", "add to it", "physic-embedded"),
        ),
        (registry(("embedded", A)), "physic-embeded:embedded", ("Did you mean 'physic-embedded:embedded'?",)),
    ],
)
def test_a_missing_name_says_what_there_is_and_where_it_comes_from(own: Registry, name: str, words: tuple[str, ...]):
    got = message(BackendNotFoundError, own.get, "inpainter", name)
    assert all(word in got for word in (f"'{name}'", *words)), got


def test_a_missing_name_beside_a_broken_plugin_names_it_and_keeps_its_cause():
    cause = ModuleNotFoundError("No module named 'x'")
    broken = BrokenPlugin(Origin("c", "physic-c", "0.3"), "ModuleNotFoundError: No module named 'x'", cause)
    with pytest.raises(BackendNotFoundError, match=r"physic-c 0\.3 \(ModuleNotFoundError") as caught:
        registry(("mock", A), broken=[broken]).get("inpainter", "fancy")
    assert caught.value.__cause__ is cause


def test_two_claims_to_one_name_are_refused_and_both_are_named():
    got = message(BackendError, registry(("x", B), ("x", A)).get, "inpainter", "x")
    assert "'physic-a:x' or 'physic-b:x'" in got
    same = message(BackendError, registry(("x", A), ("x", A)).get, "inpainter", "x")
    assert "2 times" in same


@pytest.mark.parametrize("written", ["physic-b:x", "Physic_B:x"])
def test_distribution_and_name_choose_among_rivals(written: str):
    assert registry(("x", A), ("x", B)).get("inpainter", written).origin == B


def test_a_backend_with_a_problem_is_refused_with_it():
    claim = BackendOffer(BackendRecord("inpainter", "x", "m:C", api=1), A, "needs plugin API 2, this physic-core has 1")
    assert claim.problem in message(BackendError, Registry([claim], installed=False).get, "inpainter", "x")


def test_a_target_in_a_config_works_without_packaging(site):
    (site.folder / "my_fill.py").write_text(
        "from physic_core.interfaces import Inpainter\n"
        "class Fill(Inpainter):\n"
        "    def infer(self, image, mask): return image\n"
    )
    own = Registry(installed=False)
    claim = own.get("inpainter", "my_fill:Fill")
    assert own.load_class(claim).__name__ == "Fill"
    assert "my_fill:Fill" in str(claim)


def test_a_class_is_called_by_its_target_and_says_its_interface(site):
    (site.folder / "my_other_fill.py").write_text(
        "from physic_core.interfaces import Inpainter\n"
        "class Fill(Inpainter):\n"
        "    def infer(self, image, mask): return image\n"
    )
    (claim,) = registry(("telea", A)).find_by_name("my_other_fill:Fill")
    assert claim.record.interface == "inpainter"
    assert Registry(installed=False).load_concrete_class(claim).__name__ == "Fill"


def test_a_class_that_is_called_but_is_no_backend_is_refused():
    for no_backend in ("json:dumps", "physic_core.interfaces:Backend"):
        said = message(BackendError, Registry(installed=False).find_by_name, no_backend)
        assert "should be a subclass" in said
        assert no_backend in said


@pytest.mark.parametrize(
    ("target", "source", "expected"),
    [
        ("no_such_module:C", "", "put no_such_module.py beside the config"),
        ("json:Nothing", "", "no attribute 'Nothing'"),
        ("my_failing_module:C", "import sys; sys.exit(3)", "SystemExit: 3 (my_failing_module.py:1)"),
        ("my_failing_module:C", "import no_such_module", "'no_such_module' (my_failing_module.py:1)"),
    ],
)
def test_a_target_that_cannot_be_imported_names_the_cause(tmp_path, monkeypatch, target, source, expected):
    (tmp_path / "my_failing_module.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    own = Registry(installed=False)
    got = message(BackendError, own.load_class, own.get("inpainter", target))
    assert target in got
    assert expected in got


def test_the_catalog_says_what_the_first_party_plugins_register():
    registered: dict[str, dict[str, tuple[str, ...]]] = {}
    for claim in discover():
        offers = registered.setdefault(claim.origin.distribution, {})
        offers[claim.record.interface] = (*offers.get(claim.record.interface, ()), claim.record.name)
    assert {k: registered[k] for k in CATALOG} == CATALOG
    assert list(CATALOG) == sorted(CATALOG)
