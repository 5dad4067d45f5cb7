from __future__ import annotations

import pytest

from physic_core.discovery.backends import list_backends, load_class
from physic_core.errors import BackendError
from physic_core.weights import read_manifest
from physic_core.weights.library import default_sets, licence_text, named_sets, read_library
from physic_core.weights.manifest import HubSource, WebSource, is_inside

pytestmark = pytest.mark.quick

SIMPLE = '[net]\nsummary = "A network"\nlicense = "MIT"\n[[net.files]]\npath = "model.onnx"\n'
SOURCE = 'source = "https://example.org/x"\n'


def write(tmp_path, text, name="own.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def fault(path):
    with pytest.raises(BackendError) as caught:
        read_manifest(path)
    assert str(path) in str(caught.value) or path.is_dir()
    return str(caught.value)


def test_a_set_is_read_with_all_that_it_says(tmp_path):
    path = write(
        tmp_path,
        '["net-1.5"]\nsummary = "A network"\nlicense = "CC-BY-NC-4.0"\ncommercial = '
        "false\naccount = true\n"
        'homepage = "https://example.org"\nadvice = "export b"\n'
        '[["net-1.5".files]]\npath = "deep/a.onnx"\nbytes = 7\n'
        f'sha256 = "{"ab" * 32}"\nsource = "hf://owner/repo/x/a.onnx@refs/pr/1"\n'
        '[["net-1.5".files]]\npath = "b.onnx"\n',
    )
    (found,) = read_manifest(path).values()
    assert (found.name, found.summary, found.license) == ("net-1.5", "A network", "CC-BY-NC-4.0")
    assert (found.commercial, found.account) == (False, True)
    assert (found.homepage, found.advice) == ("https://example.org", "export b")
    first, second = found.files
    assert (first.path, first.bytes, first.sha256) == ("deep/a.onnx", 7, "ab" * 32)
    assert first.origin == HubSource("owner/repo", "x/a.onnx", "refs/pr/1")
    assert (second.path, second.bytes, second.sha256, second.origin) == ("b.onnx", None, None, None)
    assert (found.bytes, found.is_free) == (None, False)


@pytest.mark.parametrize(
    ("source", "origin"),
    [
        ("hf://owner/repo/model.onnx", HubSource("owner/repo", "model.onnx", "main")),
        (
            "https://example.org/a%20b.onnx?download=1",
            WebSource("https://example.org/a%20b.onnx?download=1"),
        ),
        (
            "https://example.org/all.zip#x/end2end.onnx",
            WebSource("https://example.org/all.zip", "x/end2end.onnx"),
        ),
    ],
)
def test_every_kind_of_source_is_parsed(tmp_path, source, origin):
    (found,) = read_manifest(write(tmp_path, SIMPLE + f'source = "{source}"\n')).values()
    assert found.files[0].origin == origin


def test_a_folder_is_read_as_all_its_manifests(tmp_path):
    write(tmp_path, SIMPLE + SOURCE, "a.toml")
    write(tmp_path, (SIMPLE + SOURCE).replace("net", "other"), "b.toml")
    write(tmp_path, "no list", "notes.txt")
    assert sorted(read_manifest(tmp_path)) == ["net", "other"]
    (tmp_path / "empty").mkdir()
    assert read_manifest(tmp_path / "empty") == {}


def table(files, head='summary = "A"\nlicense = "MIT"\n'):
    return f"[net]\n{head}{files}"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("net = 3", "dictionary"),
        (table("sumary = 'A'\n" + "[[net.files]]\npath = 'a'\n" + SOURCE), "sumary"),
        (table("[[net.files]]\npath = 'a'\n" + SOURCE, "license = 'MIT'\n"), "summary"),
        (table("commercial = 'yes'\n[[net.files]]\npath = 'a'\n" + SOURCE), "commercial"),
        (table("[[net.files]]\npath = '../up'\n" + SOURCE), "path"),
        (table("[[net.files]]\npath = 'a'\nsha256 = 'AB12'\n" + SOURCE), "sha256"),
        (
            table("[[net.files]]\npath = 'a'\nsource = 'ftp://example.org/x'\n"),
            "hf://owner/repository/path",
        ),
        (
            table("[[net.files]]\npath = 'a'\n" + SOURCE + "[[net.files]]\npath = 'a'\n" + SOURCE),
            "twice",
        ),
        (
            table("[[net.files]]\npath = 'a'\nbytes = 3\nsource = 'http://example.org/x'\n"),
            "sha256",
        ),
        (table("[[net.files]]\npath = 'a'\n"), "advice"),
        (table("files = []\n"), "no files"),
        ("[net]\nsummary = A\n", "line 2"),
        ("[Net]\nsummary = 'A'\nlicense = 'MIT'\n[[Net.files]]\npath = 'a'\n" + SOURCE, "pattern"),
    ],
)
def test_a_fault_of_a_manifest_is_named(tmp_path, text, word):
    assert word in fault(write(tmp_path, text))


@pytest.mark.parametrize(
    "path",
    [
        "../x",
        "a/../../x",
        "C:/x",
        "a/",
        "/etc/x",
        "a\\..\\x",
        "",
        "\\\\host\\share\\x",
    ],
)
def test_a_path_out_of_the_folder_is_refused_everywhere(tmp_path, path):
    assert not is_inside(path)
    literal = f"'{path}'"
    for text in (
        SIMPLE.replace('"model.onnx"', literal) + SOURCE,
        SIMPLE + f"source = 'https://example.org/all.zip#{path}'\n",
        SIMPLE + f"source = 'hf://owner/repo/{path}'\n",
    ):
        assert "net" in fault(write(tmp_path, text)), text


ADAPTERS = ("metricbody-onnx", "metricbody-paper", "metricbody-omnieraser")
"""Distributions whose backends all need weights."""


def test_manifests_name_the_backends_that_use_their_sets_by_default():
    for offer in list_backends():
        kind = load_class(offer)
        fields = kind.Options.model_fields
        options = {
            name: field.get_default() for name, field in fields.items() if not field.is_required()
        }
        named = {one.name for one in named_sets(offer.distribution, options)}
        stated = default_sets(offer)
        assert {one.name for one in stated} == named, offer
        assert licence_text(stated) or offer.distribution not in ADAPTERS, offer
        if "needs_cuda" in getattr(kind, "capabilities", ()):
            assert all("a GPU" in one.needs for one in stated), offer


def test_every_installed_manifest_is_valid():
    library = read_library()
    assert library.broken == ()
