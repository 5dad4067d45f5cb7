from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from physic_core import engine_preset, engine_preset_names
from physic_core.configuration.model import as_config, load_config
from physic_core.errors import ConfigError
from physic_core.interfaces import INTERFACES

pytestmark = pytest.mark.quick


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a TOML file into an empty working folder; messages then hold the bare name."""
    monkeypatch.chdir(tmp_path)

    def write(text, name="config.toml"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)
        return name

    return write


def refusal(*args, **kwargs):
    with pytest.raises(ConfigError) as caught:
        load_config(*args, **kwargs)
    return str(caught.value)


def test_the_default_names_the_embedded_backend_everywhere():
    config = load_config()
    chosen = {name: config.choice(name).backend for name in INTERFACES}
    assert set(chosen.values()) == {"metricbody-embedded:embedded"}
    assert config.photo.max_side == 1280
    assert config.body_model.source == "embedded"
    assert config.run.device == "cpu"


@pytest.mark.parametrize(
    ("backend", "options"),
    [
        ("embedded", {"short_side": 322}),
        ("metricbody-embedded:embedded", {"short_side": 322}),
        ("physic-other:embedded", {}),
        ("mock", {}),
    ],
)
def test_options_stay_with_a_backend_whichever_way_it_is_named(backend, options):
    config = load_config(preset="light-cpu", overrides=[f"relative_pointmap.backend={backend}"])
    assert config.relative_pointmap.options == options


def test_a_file_may_extend_another_beside_it(write):
    write('extends = "mock"\n[photo]\nmax_side = 700\n', "base/base.toml")
    config = load_config(write('extends = "base/base.toml"\n[photo]\nmask_growth = 0.01\n'))
    assert config.segmenter.backend == "metricbody-testing:mock"
    assert (config.photo.max_side, config.photo.mask_growth) == (700, 0.01)


def test_later_layers_win_and_each_value_knows_its_source(write):
    file = write("[photo]\nmax_side = 800\nmask_growth = 0.01\n")
    config = load_config(
        file, overrides=["photo.max_side=900"], flags={"--device": {"run": {"device": "cuda"}}}
    )
    assert config.photo.max_side == 900
    assert [config.source(f"photo.{name}") for name in ("max_side", "mask_growth")] == [
        "--set",
        "config.toml",
    ]
    assert [config.source(path) for path in ("run.device", "engine.preset")] == [
        "--device",
        "default",
    ]
    assert config.source("segmenter.backend") == "preset embedded"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("inpainter.backend=telea", "telea"),
        ('inpainter.backend="my fill"', "my fill"),
        ("inpainter.backend=my_pkg.fill:Fill", "my_pkg.fill:Fill"),
        ("inpainter = {backend = 'telea'}", "telea"),
    ],
)
def test_an_override_is_toml_and_a_bare_word_is_a_text(override, expected):
    assert load_config(overrides=[override]).inpainter.backend == expected


def test_options_of_another_backend_are_not_inherited(write):
    file = write('[inpainter]\nbackend = "telea"\n[inpainter.options]\nradius_px = 3.0\n')
    assert load_config(file).inpainter.options == {"radius_px": 3.0}
    assert load_config(file, overrides=["inpainter.options.max_hole_px=99"]).inpainter.options == {
        "radius_px": 3.0,
        "max_hole_px": 99,
    }
    assert load_config(file, overrides=["inpainter.backend=mock"]).inpainter.options == {}


def test_a_later_camera_replaces_an_earlier_one_however_it_was_given(write):
    file = write("[photo]\nfocal_px = 900\n")
    config = load_config(file, overrides=["photo.intrinsics=[800, 810, 320, 240]"])
    assert (config.photo.focal_px, config.photo.intrinsics) == (None, (800.0, 810.0, 320.0, 240.0))


def test_a_body_model_path_is_relative_to_its_file(write):
    config = load_config(write('[body_model]\npath = "SMPLX_NEUTRAL.npz"\n', "sub/config.toml"))
    assert config.body_model.source == str(Path("sub/SMPLX_NEUTRAL.npz").absolute())


@pytest.mark.parametrize("preset", engine_preset_names())
def test_a_config_accepts_every_preset_of_the_engine(preset):
    known = engine_preset(preset)
    said = {
        stage: asdict(getattr(known, stage)) for stage in ("scene", "placement", "joint", "contact")
    }
    assert as_config({"engine": {"preset": preset, **said}}).engine.settings() == known


def test_engine_overrides_reach_the_settings():
    changes = [
        "scene.floor=off",
        "joint.frozen=['root']",
        "placement.robust_m=inf",
        "joint.optimiser.steps=40",
    ]
    settings = load_config(
        overrides=["engine.preset=paper", *(f"engine.{one}" for one in changes)]
    ).engine.settings()
    assert type(settings.scene) is type(engine_preset("paper").scene)
    assert (settings.scene.floor, settings.placement.robust_m) == ("off", float("inf"))
    assert (settings.joint.frozen, settings.joint.optimiser.steps) == (("root",), 40)


def test_python_callers_may_pass_a_config_a_preset_a_file_tables_or_nothing(write):
    config = load_config(preset="mock")
    assert as_config(config) is config
    assert as_config(None) == load_config()
    assert as_config("mock") == config
    assert as_config(write('extends = "mock"\n')).as_dict() == config.as_dict()
    assert as_config(Path("config.toml")).as_dict() == config.as_dict()
    assert as_config({"photo": {"max_side": 640}}).photo.max_side == 640


def test_a_variable_goes_over_the_file_and_under_an_override(write):
    file = write('[inpainter]\nbackend = "telea"\n[photo]\nmax_side = 800\nmask_growth = 0.01\n')
    variables = {
        "PHYSIC__PHOTO__MAX_SIDE": "900",
        "PHYSIC__PHOTO__MASK_GROWTH": "0.02",
        "PHYSIC__INPAINTER__BACKEND": "telea",
        "PHYSIC__INPAINTER__OPTIONS__RADIUS_PX": "7.0",
        "PHYSIC__RUN__DEVICE": "",
        "PHYSIC_PLUGINS": "none of this",
    }
    config = load_config(file, overrides=["photo.mask_growth=0.03"], environment=variables)
    assert (config.photo.max_side, config.photo.mask_growth, config.run.device) == (
        900,
        0.03,
        "cpu",
    )
    assert (config.inpainter.backend, config.inpainter.options) == (
        "telea",
        {"radius_px": 7.0},
    )
    assert config.source("photo.max_side") == "PHYSIC__PHOTO__MAX_SIDE"
    assert config.source("photo.mask_growth") == "--set"


def test_the_environment_of_the_process_is_read(monkeypatch):
    monkeypatch.setenv("PHYSIC__INPAINTER__BACKEND", "telea")
    assert load_config().inpainter.backend == "telea"
    assert as_config("mock").inpainter.backend == "telea"
    assert as_config({"inpainter": {"backend": "telea"}}).inpainter.backend == "telea"


def test_a_variable_that_is_wrong_is_named():
    assert "PHYSIC__PHOTO__MAX_SID: photo.max_sid: unknown" in refusal(
        environment={"PHYSIC__PHOTO__MAX_SID": "900"}
    )
    assert "PHYSIC__PHOTO____MAX_SIDE" in refusal(environment={"PHYSIC__PHOTO____MAX_SIDE": "900"})


def written(config):
    """A reconstruction.json with a configuration, as a run writes it."""
    tables = config.as_dict()
    tables["engine"]["placement"] = {"robust_m": "Infinity"}
    Path("reconstruction.json").write_text(
        json.dumps({"schema": "physic.reconstruction", "config": tables})
    )
    return "reconstruction.json"


def test_a_result_stands_for_the_configuration_that_made_it(write):
    file = write('extends = "mock"\n[photo]\nfocal_px = 700\n[inpainter.options]\nnoise = 2.0\n')
    config = load_config(file)
    again = load_config(written(config), overrides=["run.device=cuda"])
    assert again.engine.settings().placement.robust_m == float("inf")
    assert again.as_dict() | {"engine": 0, "run": 0} == config.as_dict() | {"engine": 0, "run": 0}
    assert again.source("inpainter.backend") == "reconstruction.json"
    assert load_config(write('extends = "reconstruction.json"\n')).photo.focal_px == 700


def test_every_fault_is_a_line_with_source_path_and_suggestion(write):
    file = write(
        'extends = "embedded"\n'
        "colour = 3\n"
        '[inpaintr]\nbackend = "telea"\n'
        '[segmenter]\nbackend = "none"\n'
        "[photo]\nmax_side = 3\nfocal = 2\n"
        "[engine.scene]\ncarve = 3\nfloor = 'flat'\n"
    )
    lines = refusal(file, overrides=["engine.joint=3"]).splitlines()
    for start, word in (
        ("config.toml: photo.max_side: ", "(got 3)"),
        ("config.toml: photo.focal: ", "Did you mean 'focal_px'?"),
        ("config.toml: colour: ", "unknown key"),
        ("config.toml: inpaintr: ", "Did you mean 'inpainter'?"),
        ("config.toml: segmenter: ", "contact_prior"),
        ("config.toml: engine.scene.floor: ", "'disparity' or 'off'"),
        ("config.toml: engine.scene.carve: ", "Did you mean 'carve_m'?"),
        ("--set: engine.joint: ", "(got 3)"),
    ):
        (line,) = [line for line in lines if line.startswith(start)]
        assert word in line
    assert len(lines) == 8


@pytest.mark.parametrize(
    ("override", "path", "word"),
    [
        ("photo.max_side=12.5", "photo.max_side", "integer"),
        ("photo.intrinsics=[1, 2, 3]", "photo.intrinsics.3", "missing"),
        ("photo={focal_px=9, intrinsics=[9, 9, 4, 4]}", "photo", "both focal_px and intrinsics"),
        (
            "photo={intrinsics=[9, 9, 4, 4], distortion=[0, 0, 0, 0, inf]}",
            "photo.distortion.4",
            "should be",
        ),
        ("inpainter=telea", "inpainter", "is a table: set a key of it, such as inpainter.backend"),
        ("inpainter.option.x=1", "inpainter.option", "Did you mean 'options'?"),
        ("run.device=gpu", "run.device", "cuda"),
        ("engine.scene.carve_m=nan", "engine.scene.carve_m", "nan"),
        # which would take no step for ever
        ("engine.joint.optimiser.refresh_steps=0", "engine.joint.optimiser.refresh_steps", "to 1"),
    ],
)
def test_an_invalid_value_is_named_with_its_path_and_what_it_should_be(override, path, word):
    message = refusal(overrides=[override])
    assert message.startswith(f"--set: {path}: ")
    assert word in message


def test_a_preset_that_does_not_exist_is_named_with_those_that_do(write):
    assert "light-cpu, mock, open, open-body, paper. Did you mean 'embedded'?" in refusal(
        preset="embeded"
    )
    assert "config.toml extends 'splendid': no preset" in refusal(write('extends = "splendid"\n'))


def test_a_file_that_cannot_be_read_is_named_with_the_file_that_extends_it(write):
    assert "none.toml" in refusal("none.toml")
    assert "config.toml extends 'other.toml': " in refusal(write('extends = "other.toml"\n'))
    assert "(got 3)" in refusal(write("extends = 3\n"))
    assert "config.toml is not valid TOML" in refusal(write("inpainter:\n  backend: telea\n"))
    Path("config.toml").write_bytes(b"\xff\xfe\x00")
    assert "UTF-8" in refusal("config.toml")
    for text in ("{}", "[[null]]", '{"config": [[null]]}', '{"config": true}'):
        assert "result.json is not the reconstruction.json of a run" in refusal(
            write(text, "result.json")
        )


def test_files_that_extend_each_other_are_refused(write):
    write('extends = "a.toml"\n', "b.toml")
    assert "a.toml extends itself" in refusal(write('extends = "b.toml"\n', "a.toml"))


@pytest.mark.parametrize("text", ["inpainter", "=3", "a b=3", "a..b=3"])
def test_an_override_without_a_key_and_a_value_is_refused(text):
    assert "inpainter.backend" in refusal(overrides=[text])
