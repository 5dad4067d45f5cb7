from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from physic_core.cli import main
from physic_core.cli.commands.config import config_toml
from physic_core.configuration.layers import preset_names
from physic_core.configuration.model import load_config
from physic_core.errors import InputError
from physic_core.types import StageRecord

from .results import empty_reconstruction

pytestmark = pytest.mark.quick


def refusal(*arguments, code=2):
    done = CliRunner().invoke(main, [*arguments])
    assert (done.exit_code, done.stdout) == (code, ""), done.output
    return done.stderr.removeprefix("Error: ").rstrip("\n")


@pytest.fixture(autouse=True)
def small_result(pipeline):
    stages = (StageRecord("people", 1.25, 0.5), StageRecord("scene", 2.0))
    told = {"warnings": ("no floor was found",), "notes": ("focal length is a default",)}
    pipeline.result = lambda path: empty_reconstruction(stages=stages, **told)


def run(*arguments):
    return ("run", "photo.jpg", "--preset", "mock", "--save", "numbers", *arguments)


ARRAYS = ("reconstruction.json", "reconstruction.npz")


def names():
    return sorted(path.name for path in Path("photo-physic").iterdir())


def test_run_writes_beside_the_photo_and_says_what_was_found(pipeline, physic):
    done = physic(*run())
    assert done.exit_code == 0, done.output
    for words in (
        "no person",
        "3.2 s",
        "note: focal length",
        "warning: no floor",
        "no people",
        "photo-physic/\n",
    ):
        assert words in done.stdout
    assert done.stderr.startswith("[1/2] people\n[2/2] scene\n")
    assert "--focal-px PX" in done.stderr
    assert names() == ["people.csv", *ARRAYS]
    assert pipeline.calls[0][0] == Path("photo.jpg")


def test_run_ends_with_the_path_of_the_page(pipeline, physic):
    assert physic(*run("--report")).stdout.splitlines()[-1] == "page: photo-physic/report.html"
    assert Path("photo-physic/report.html").is_file()


def test_run_without_a_plugin_for_pictures_refuses_them_before_it_starts(
    pipeline, monkeypatch, physic
):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-testing")
    for options in (("--save", "pictures"), ("--save", "numbers", "--report"), ("--open",)):
        assert "metricbody-visual, which is not installed" in refusal(*run(*options), code=4)
    assert pipeline.calls == []
    assert physic(*run("--save", "numbers")).exit_code == 0
    assert names() == ["people.csv", *ARRAYS]


def test_show_prints_what_the_run_printed(pipeline, physic):
    done = physic(*run())
    assert physic("show", "photo-physic").stdout == done.stdout
    assert "people: 1.2 s\nscene: 2.0 s\n" in physic("show", "photo-physic", "-v").stdout
    assert "photos/reconstruction.json: there is no such file" in refusal("show", "photos", code=3)


def test_run_keeps_what_fails_cheaply_in_front_of_the_pipeline(pipeline):
    Path("taken").write_text("")
    long = "x" * 300  # a folder that may not be entered
    for arguments, message in (
        (run("--set", "photo.max_side=1"), "--set: photo.max_side: "),
        (run("--device", "foo"), "'--device'"),
        (("run", "photo.jpg", "--preset", "no"), "no preset named 'no'; there are: "),
        (run("-o", "taken"), "taken: it is a file"),
        (run("-o", "taken/deep"), "taken: it is a file"),
        (run("-o", f"new/{long}/deep"), ": File name too long"),
        (run("-o", long), ": File name too long"),
    ):
        assert message in refusal(*arguments)
    assert pipeline.calls == []
    assert [p.name for p in Path().iterdir()] == ["taken"]


def test_a_missing_gpu_is_reported(pipeline, monkeypatch):
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert f"torch {torch.__version__} finds no CUDA GPU" in refusal(*run("--device", "cuda"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    assert "only 'cuda:0' is" in refusal(*run("--device", "cuda:1"))


def test_a_run_that_fails_leaves_no_empty_folder_and_the_older_result(pipeline, physic):
    pipeline.error = InputError("no photo at photo.jpg")
    Path("mine").mkdir()
    Path("mine/old").write_text("old")
    assert physic(*run("-o", "mine")).exit_code == 2
    done = physic(*run("-o", "mine/new/deep"))
    assert (done.exit_code, done.stdout, done.stderr) == (
        3,
        "",
        "[1/2] people\nError: no photo at photo.jpg\n",
    )
    assert [path.read_text() for path in Path("mine").iterdir()] == ["old"]


def test_a_lack_of_memory_is_a_message(pipeline, physic):
    pipeline.error = MemoryError("Unable to allocate 4.85 MiB")
    done = physic(*run())
    assert done.exit_code == 1
    assert done.stderr.splitlines()[-1].startswith("Error: out of memory. Close other programs")


def test_debug_shows_the_traceback(pipeline, monkeypatch, physic):
    pipeline.error = InputError("no photo at photo.jpg")
    monkeypatch.setenv("PHYSIC_DEBUG", "1")
    done = physic(*run())
    assert done.exit_code == 3
    assert "Traceback (most recent call last):" in done.stderr
    assert done.stderr.endswith("\nError: no photo at photo.jpg\n")


def test_the_listing_names_interface_backend_and_plugin_of_each_backend(site, physic):
    site.offer("physic-mine", "inpainter", "own", version="1.2")
    head, *rows = physic("plugins", "--interface", "inpainter").stdout.splitlines()
    assert head.split() == ["interface", "backend", "plugin", "version", "state"]
    (own,) = (row for row in rows if "physic-mine" in row)
    assert own.split()[:5] == ["inpainter", "own", "physic-mine", "1.2", "ready;"]
    assert "never passed `physic plugins check own` here" in own
    assert {row.split()[0] for row in rows} == {"inpainter"}


MANIFEST = """
[free]
summary = "A network"
license = "MIT"
commercial = true
homepage = "https://example.org/free"
files = [{path = "free.onnx", source = "https://example.org/free.onnx"}]
[odd]
summary = "A network"
license = "Odd License"
commercial = false
files = [{path = "odd.onnx", source = "https://example.org/odd.onnx"}]
"""
NET = """
from pydantic import Field
from physic_core import interfaces

class Net(interfaces.Inpainter):
    \"\"\"Fills holes.\"\"\"

    written_for = 1
    weights_license = "MIT (Net)"

    class Options(interfaces.Options):
        weights: str = Field({!r}, description="a set")
        detector: str = Field("free", description="another set")

    def infer(self, image, mask): return image
"""


def test_the_listing_says_what_a_backend_needs_without_its_import(
    site, tmp_path, monkeypatch, physic
):
    manifest = MANIFEST.replace(
        "[odd]", '[odd]\ndefault_of = ["inpainter.net"]\nneeds = "a GPU, a key"'
    )
    folder = site.list_weights("physic-lists", manifest).parent
    entry = f"[physic.inpainter]\nnet = physic_net:Net\n[physic.weights]\nnet = {folder.name}\n"
    site.install("physic-net", "raise ImportError('imported')", entry=entry)

    def state():
        rows = physic("plugins", "--interface", "inpainter").stdout.splitlines()
        return next(row for row in rows if " net " in row)

    assert state().endswith(" needs weights, a GPU, a key")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "odd.onnx").touch()
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path))
    assert state().endswith(" needs a GPU, a key")


@pytest.mark.parametrize(
    ("default", "printed"), [("odd", "Odd License, no commercial use; MIT"), ("free", "MIT")]
)
def test_details_show_the_licences_of_the_default_weights(site, default, printed, physic):
    folder = site.list_weights("physic-lists", MANIFEST).parent
    entry = f"[physic.inpainter]\nnet = physic_net:Net\n[physic.weights]\nnet = {folder.name}\n"
    site.install("physic-net", NET.format(default), entry=entry)
    shown = physic("plugins", "show", "net").stdout
    for words in (
        "  Fills holes.\n",
        f"weights   {printed}\n",
        "homepage  https://example.org/free\n",
    ):
        assert words in shown


def test_check_prints_ok_or_the_faults(physic):
    Path("my.toml").write_text('extends = "mock"\n[photo]\nmax_side = 640\n')
    assert physic("config", "check", "--config", "my.toml").stdout == "my.toml: no errors\n"
    assert refusal(
        "config", "check", "--config", "my.toml", "--set", "inpainter.backend=telae"
    ).startswith("--set: inpainter.backend: no inpainter named 'telae'; installed: ")
    done = physic(
        "config", "check", "--config", "my.toml", "--set", "body_model.path=SMPLX_NEUTRAL.npz"
    )
    assert done.exit_code == 4
    assert "1 thing is missing; a run would stop:\n  body_model.path: no file at " in done.stdout


@pytest.mark.parametrize("preset", preset_names())
def test_config_show_prints_toml_that_gives_the_same_config(preset):
    config = load_config(
        preset=preset,
        overrides=["inpainter.options={a=[1, 2.5], b={c='ü\"\\n'}}", "photo.focal_px=9"],
    )
    printed = tomllib.loads(config_toml(config))
    assert load_config(flags={"shown": printed}).as_dict() == config.as_dict()


def test_show_says_where_each_value_is_from(physic):
    Path("my.toml").write_text("[photo]\nmax_side = 640\n")
    shown = physic("config", "show", "--config", "my.toml", "--set", "run.device=cuda").stdout
    assert "max_side = 640  # my.toml\n" in shown
    assert 'device = "cuda"  # --set\n' in shown
    assert "mask_growth = 0.008  # default\n" in shown
    assert '[segmenter]\nbackend = "metricbody-embedded:embedded"  # preset embedded\n' in shown
