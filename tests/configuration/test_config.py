from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from physic_core import engine_preset, engine_preset_names
from physic_core.configuration.model import Config, as_config, load_config, preset_names
from physic_core.discovery.catalog import distribution_for
from physic_core.errors import ConfigError
from physic_core.interfaces import PHOTO_INTERFACES


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Write a TOML file into an empty working folder; messages then hold the bare name."""
    monkeypatch.chdir(tmp_path)

    def write(text: str, name: str = "config.toml") -> str:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)
        return name

    return write


def refusal(*args: Any, **kwargs: Any) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(*args, **kwargs)
    return str(caught.value)


def test_the_default_names_the_embedded_backend_everywhere():
    config = load_config()
    assert {config.choice(i).backend for i in PHOTO_INTERFACES} == {"physic-embedded:embedded"}
    assert config.photo.max_side == 1280
    assert config.body_model.source == "embedded"
    assert config.run.device == "cpu"


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_names_the_distribution_of_each_backend(name: str):
    config = load_config(preset=name)
    for interface in PHOTO_INTERFACES:
        distribution, _, backend = config.choice(interface).backend.rpartition(":")
        assert backend == "none" or distribution == distribution_for(interface, backend)


@pytest.mark.parametrize(
    ("backend", "options"),
    [
        ("embedded", {"short_side": 322}),
        ("physic-embedded:embedded", {"short_side": 322}),
        ("Physic_Embedded:embedded", {"short_side": 322}),
        ("physic-other:embedded", {}),
        ("mock", {}),
    ],
)
def test_options_stay_with_a_backend_whichever_way_it_is_named(backend: str, options: dict[str, int]):
    config = load_config(preset="light-cpu", overrides=[f"relative_pointmap.backend={backend}"])
    assert config.relative_pointmap.options == options


def test_a_file_builds_on_the_default_preset_without_saying_so(write):
    config = load_config(write("[photo]\nmax_side = 800\n"))
    assert config.photo.max_side == 800
    assert config.segmenter.backend == "physic-embedded:embedded"


def test_a_file_may_extend_another_beside_it(write):
    write('extends = "mock"\n[photo]\nmax_side = 700\n', "base/base.toml")
    config = load_config(write('extends = "base/base.toml"\n[photo]\nmask_growth = 0.01\n'))
    assert config.segmenter.backend == "physic-mock:mock"
    assert (config.photo.max_side, config.photo.mask_growth) == (700, 0.01)


def test_later_layers_win_and_each_value_knows_its_source(write):
    file = write("[photo]\nmax_side = 800\nmask_growth = 0.01\n")
    config = load_config(file, overrides=["photo.max_side=900"], flags={"--device": {"run": {"device": "cuda"}}})
    assert config.photo.max_side == 900
    assert [config.source(f"photo.{name}") for name in ("max_side", "mask_growth")] == ["--set", "config.toml"]
    assert [config.source(path) for path in ("run.device", "engine.preset")] == ["--device", "default"]
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
def test_an_override_is_toml_and_a_bare_word_is_a_text(override: str, expected: str):
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
    assert config.body_model.source == str(Path("sub/SMPLX_NEUTRAL.npz"))


@pytest.mark.parametrize("preset", engine_preset_names())
def test_a_config_accepts_every_preset_of_the_engine(preset):
    known = engine_preset(preset)
    said = {stage: asdict(getattr(known, stage)) for stage in ("scene", "placement", "joint", "contact")}
    assert as_config({"engine": {"preset": preset, **said}}).engine.settings() == known


def test_engine_overrides_reach_the_settings():
    config = load_config(overrides=["engine.preset=paper", "engine.scene.far_m=20", "engine.scene.floor=off"])
    settings = config.engine.settings()
    assert (settings.scene.far_m, settings.scene.floor) == (20.0, "off")
    assert type(settings.scene) is type(engine_preset("paper").scene)
    strict = load_config(
        overrides=["engine.joint.frozen=['root']", "engine.placement.robust_m=inf", "engine.joint.optimiser.steps=40"]
    )
    joint = strict.engine.settings().joint
    assert (joint.frozen, joint.optimiser.steps) == (("root",), 40)
    assert strict.engine.settings().placement.robust_m == float("inf")


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
        "PHYSIC__INPAINTER__BACKEND": "navier-stokes",
        "PHYSIC__INPAINTER__OPTIONS__RADIUS_PX": "7.0",
        "PHYSIC__RUN__DEVICE": "",
        "PHYSIC_PLUGINS": "none of this",
    }
    config = load_config(file, overrides=["photo.mask_growth=0.03"], environment=variables)
    assert (config.photo.max_side, config.photo.mask_growth, config.run.device) == (900, 0.03, "cpu")
    assert (config.inpainter.backend, config.inpainter.options) == ("navier-stokes", {"radius_px": 7.0})
    assert config.source("photo.max_side") == "PHYSIC__PHOTO__MAX_SIDE"
    assert config.source("photo.mask_growth") == "--set"


def test_the_environment_of_the_process_is_read(monkeypatch):
    monkeypatch.setenv("PHYSIC__INPAINTER__BACKEND", "telea")
    assert load_config().inpainter.backend == "telea"
    assert as_config("mock").inpainter.backend == "telea"
    assert as_config({"inpainter": {"backend": "navier-stokes"}}).inpainter.backend == "navier-stokes"


def test_a_variable_that_is_wrong_is_named():
    assert "photo.max_sid   unknown key" in refusal(environment={"PHYSIC__PHOTO__MAX_SID": "900"})
    assert refusal(environment={"PHYSIC__PHOTO____MAX_SIDE": "900"}) == (
        "the variable PHYSIC__PHOTO____MAX_SIDE does not name a setting: write PHYSIC__INPAINTER__BACKEND=telea"
    )
    text = refusal(environment={"PHYSIC__INPAINTER__BACKEND": "te lea"})
    assert text.startswith("the variable PHYSIC__INPAINTER__BACKEND=te lea: the value is not valid TOML (")


def written(config: Config) -> str:
    """A reconstruction.json with a configuration, as a run writes it."""
    from physic_core.io.document import encode_document

    tables = config.as_dict()
    tables["engine"]["placement"] = {"robust_m": "Infinity"}
    Path("reconstruction.json").write_bytes(encode_document({"schema": "physic.reconstruction", "config": tables}))
    return "reconstruction.json"


def test_a_result_stands_for_the_configuration_that_made_it(write):
    file = write('extends = "mock"\n[photo]\nfocal_px = 700\n[inpainter.options]\nnoise = 2.0\n')
    config = load_config(file)
    again = load_config(written(config), overrides=["run.device=cuda"])
    assert again.engine.settings().placement.robust_m == float("inf")
    assert again.as_dict() | {"engine": 0, "run": 0} == config.as_dict() | {"engine": 0, "run": 0}
    assert again.source("inpainter.backend") == "reconstruction.json"
    assert load_config(write('extends = "reconstruction.json"\n')).photo.focal_px == 700


def test_every_fault_is_reported_at_once_with_path_source_and_suggestion(write):
    file = write(
        'extends = "embedded"\n'
        "colour = 3\n"
        '[inpaintr]\nbackend = "telea"\n'
        '[segmenter]\nbackend = "none"\n'
        "[photo]\nmax_side = 3\nfocal = 2\nmask_growth = 'wide'\n"
        "[engine.scene]\nfloor_under_peple = 3\nfloor = 'flat'\n"
        "[run]\ndevice = 3\n"
    )
    assert refusal(file, overrides=["engine.joint=3"]) == (
        "config.toml: 9 errors\n"
        "photo.max_side                   should be >= 128 (got 3)\n"
        "photo.mask_growth                should be a number (got 'wide')\n"
        "photo.focal                      unknown key. Did you mean 'focal_px'?\n"
        "run.device                       should be a string (got 3)\n"
        "colour                           unknown key\n"
        "inpaintr                         unknown key. Did you mean 'inpainter'?\n"
        "segmenter.backend                should name a backend: "
        "only hand_estimator, contact_prior, camera_solver may be 'none'\n"
        "engine.scene.floor               should be 'disparity' or 'off' (got 'flat')\n"
        "engine.scene.floor_under_peple   unknown setting. Did you mean 'floor_under_people'?\n"
        "--set: 1 error\n"
        "engine.joint   should be a table (got 3)"
    )


@pytest.mark.parametrize("device", ["gpu", "tpu", "cuda:", "cuda:x", "CPU", "cuda:1 ", ""])
def test_a_device_is_called_as_torch_calls_it(device: str):
    assert f"should be 'cpu', 'cuda' or 'cuda:N' (got '{device}')" in refusal(overrides=[f"run.device='{device}'"])
    assert load_config(overrides=["run.device=cuda:12"]).run.device == "cuda:12"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("photo.max_side=12.5", "photo.max_side   should be a whole number (got 12.5)"),
        ("photo.focal_px=-1", "photo.focal_px   should be >= 1 (got -1)"),
        ("photo.focal_px=inf", "photo.focal_px   should be <= 1000000 (got inf)"),
        ("photo.intrinsics=[9, 9, inf, 4]", "photo.intrinsics   should be four finite numbers fx, fy, cx, cy with"),
        ("photo.intrinsics=[1, 2, 3]", "photo.intrinsics   should be four finite numbers fx, fy, cx, cy with fx > 0"),
        ("photo={focal_px=9, intrinsics=[9, 9, 4, 4]}", "photo   has both focal_px and intrinsics: give only one"),
        ("photo=3", "photo   should be a table (got 3)"),
        ("inpainter=telea", "inpainter   should be a table (got 'telea')"),
        ("inpainter.backend=''", "inpainter.backend   should not be empty"),
        ("inpainter.option.x=1", "inpainter.option   unknown key. Did you mean 'options'?"),
        ("inpainter.options=1", "inpainter.options   should be a table (got 1)"),
        ("body_model.name=smplx", "body_model   name should be 'embedded' (got 'smplx'); for your own file, set"),
        ("engine.preset=papr", "engine.preset   no engine preset named 'papr'; there are: default, paper, prox"),
        ("engine.scen.floor=off", "engine.scen   unknown key. Did you mean 'scene'?"),
        ("engine.scene.far_m=deep", "engine.scene.far_m   should be a number (got 'deep')"),
        ("engine.scene.carve_m=-0.1", "engine.scene.carve_m   should be >= 0 (got -0.1)"),
        ("engine.scene.carve_m=nan", "engine.scene.carve_m   should be <= 100000000 (got nan)"),
        ("engine.scene.carve_m=inf", "engine.scene.carve_m   should be <= 100000000 (got inf)"),
        ("engine.joint.optimiser.refresh_steps=0", "engine.joint.optimiser.refresh_steps   should be >= 1 (got 0)"),
        ("engine.placement.min_confidence=1.5", "engine.placement.min_confidence   should be <= 1 (got 1.5)"),
        ("engine.joint.contact.sigma_m=0", "engine.joint.contact.sigma_m   should be >= 0.000001 (got 0)"),
        ("engine.joint.visibility.facing_deg=400", "engine.joint.visibility.facing_deg   should be <= 180 (got 400)"),
        ("engine.placement.floor_weight=-1", "engine.placement.floor_weight   should be >= 0 (got -1)"),
        ("engine.scene.floor_under_people=1", "engine.scene.floor_under_people   should be true or false (got 1)"),
    ],
)
def test_a_value_that_does_not_hold_says_what_it_should_be(override: str, expected: str):
    assert refusal(overrides=[override]).startswith(f"--set: 1 error\n{expected}")


def test_a_preset_that_does_not_exist_says_which_do():
    assert refusal(preset="embeded") == (
        "no preset named 'embeded'; there are: best, embedded, light-cpu, mock, open, paper. Did you mean 'embedded'?"
    )


def test_a_missing_file_of_extends_is_reported_with_the_config_that_names_it(write):
    assert "config.toml extends 'splendid': no preset named 'splendid'" in refusal(write('extends = "splendid"\n'))
    assert "config.toml extends 'other.toml': no config file" in refusal(write('extends = "other.toml"\n'))
    assert "extends   should be the name of a preset or a path (got 3)" in refusal(write("extends = 3\n"))


def test_files_that_extend_each_other_are_refused(write, tmp_path):
    write('extends = "a.toml"\n', "b.toml")
    a, b = tmp_path / "a.toml", tmp_path / "b.toml"
    assert refusal(write('extends = "b.toml"\n', "a.toml")) == (
        f"a.toml extends 'b.toml': b.toml extends 'a.toml': a.toml extends itself: {a} -> {b} -> {a}"
    )


def test_a_file_that_is_not_there_not_toml_or_not_text_is_refused(write, tmp_path):
    assert refusal("none.toml") == "no config file at none.toml: check the path"
    assert refusal(write("[photo\n")).startswith("config.toml is not valid TOML: ")
    for name in ("config.yaml", "config.yml", "config.toml"):
        assert refusal(write("# mine\n\ninpainter:\n  backend: telea\n", name)) == (
            f'{name} is YAML, but TOML is needed: write [inpainter] on a line, and backend = "telea" below it'
        )
    Path("config.toml").write_bytes(b"\xff\xfe\x00")
    assert refusal("config.toml").endswith("; save it as UTF-8")
    assert refusal(tmp_path) == f"cannot read the config {tmp_path}: Is a directory; name a TOML file"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize(
    ("name", "cure"), [("a.toml", "name a TOML file"), ("a.json", "name the reconstruction.json of a run")]
)
def test_a_pipe_is_no_config(tmp_path: Path, name: str, cure: str) -> None:
    """In a process of its own: opening a pipe waits for ever."""
    os.mkfifo(tmp_path / name)
    code = "import sys; from physic_core.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "config", "check", str(tmp_path / name)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert f"cannot read the config {tmp_path / name}: it is not a regular file; {cure}" in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no devices here")
@pytest.mark.parametrize("name", ["/dev/zero", "/dev/stdin"])
def test_a_device_is_no_config(name: str, tmp_path: Path):
    (tmp_path / "a.toml").symlink_to(name)
    assert refusal(tmp_path / "a.toml").startswith(f"cannot read the config {tmp_path / 'a.toml'}: ")


DEEP = "it is nested too deeply"
DIGITS = "an integer has thousands of digits"
BITS = "should have at most 64 bits (got an integer of 20,000)"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a = " + "[" * 3000, f"config.toml is not valid TOML: {DEEP}"),
        ("run.threads = " + "9" * 5000, f"config.toml is not valid TOML: {DIGITS}"),
        ("run.threads = 0x" + "f" * 5000, f"config.toml: 1 error\nrun.threads   {BITS}"),
        ("photo.x = " + "[" * 20 + "]" * 20, "config.toml: 1 error\nphoto.x   is nested more than 16 deep"),
        (f"{'a.' * 400}b = 1", f"config.toml: 1 error\n{'a.' * 16}a   is nested more than 16 deep"),
        (
            'photo.masks = "a\\u0000"',
            "config.toml: photo.masks: a path must not contain null characters (got 'a\\x00')",
        ),
        ('inpainter.backend = "a\\u0000"', "inpainter.backend   should not contain null characters (got 'a\\x00')"),
        (f'inpainter.backend = "{"a" * 10_001}"', "inpainter.backend   should have at most 10,000 characters"),
        (f"photo.person = [{'0,' * 100_000}]", "photo.person   has more than 100,000 values"),
        ('extends = "~nobody-of-this-name/a.toml"', "no config file at ~nobody-of-this-name/a.toml: check the path"),
        (f'extends = "{"a" * 300}.toml"', f"{'a' * 129} ... {'a' * 61}.toml: File name too long; name a TOML file"),
        ('photo."\\u001b[2J" = 1', "config.toml: 1 error\nphoto.\\x1b[2J   unknown key"),
    ],
    ids=lambda value: value[:20],
)
def test_hostile_values_are_one_short_error(write, text: str, expected: str):
    message = refusal(write(text))
    assert expected in message
    assert len(message) < 500


def test_hostile_variables_and_overrides_are_one_short_error():
    assert "the variable PHYSIC__É does not name a setting" in refusal(environment={"PHYSIC__É": "1"})
    line = "run.threads=1\nrun.cache=false"
    assert refusal(overrides=[line]) == f"--set {line}: expected one value without a line break"
    message = refusal(overrides=["run.threads=" + "9" * 5000])
    assert message.startswith("--set: 1 error\nrun.threads   ")
    assert len(message) < 300


def test_hostile_tables_of_python_are_one_short_error():
    table: dict[Any, Any] = {}
    table["photo"] = table
    with pytest.raises(
        ConfigError, match=r"\Aconfig: 1 error\n(photo\.)+ph \.\.\. oto(\.photo)+   is nested more than 16 deep\Z"
    ):
        as_config(table)
    with pytest.raises(ConfigError, match=r"\Aconfig: 1 error\n3   is not a valid setting name\Z"):
        as_config({3: {}})
    with pytest.raises(ConfigError, match=r"\Aa config should be a preset, .* a mapping or a Config \(got 3\)\Z"):
        as_config(3)  # type: ignore[arg-type]


def test_a_message_of_many_errors_counts_those_that_have_no_room(write):
    message = refusal(write("".join(f"unknown_setting_{i} = 1\n" for i in range(1000))))
    assert message.startswith("config.toml: 1000 errors\nunknown_setting_0     unknown key\n")
    shown = message.count("unknown key")
    assert message.endswith(f"\nand {1000 - shown} more errors")
    assert 3800 < len(message) < 4096


def test_a_chain_of_many_files_is_refused(write):
    for i in range(20):
        write(f'extends = "{i + 1}.toml"\n', f"{i}.toml")
    assert refusal("0.toml").endswith("more than 16 files extend each other; the last is 16.toml")


def test_infinite_settings_are_kept(write):
    config = load_config(write("[engine.scene]\nfar_m = inf\n[inpainter.options]\na = -inf\n"))
    assert config.as_dict()["engine"]["scene"] == {"far_m": float("inf")}
    assert config.as_dict()["inpainter"]["options"] == {"a": float("-inf")}


@pytest.mark.parametrize("text", ["inpainter", "=3", "a b=3", "a..b=3", "é=1"])
def test_an_override_without_a_key_and_a_value_is_refused(text: str):
    assert refusal(overrides=[text]) == f"--set needs KEY=VALUE such as inpainter.backend=telea (got '{text}')"


def test_an_override_that_is_no_toml_is_refused():
    text = refusal(overrides=["inpainter.backend=te lea"])  # the words in the brackets are Python's
    assert text.startswith("--set inpainter.backend=te lea: the value is not valid TOML (")
    assert text.endswith("); strings need quotes")


@pytest.mark.parametrize(("name", "limit"), [("my.toml", 1_000_000), ("reconstruction.json", 100_000_000)])
def test_a_file_that_is_too_large_for_a_config_is_not_read(tmp_path: Path, name: str, limit: int):
    file = tmp_path / name
    with file.open("wb") as stream:
        stream.truncate(10 * limit)
    assert f"it has {10 * limit:,} bytes, more than {limit:,}; " in refusal(file)
