"""``physic config schema``: editors accept what the checks accept."""

from __future__ import annotations

import tomllib

import jsonschema
import pytest

from physic_core.configuration.layers import preset_names
from physic_core.configuration.model import load_config
from physic_setup.schema import config_schema

pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def schema():
    return config_schema()


def faults(schema, text):
    found = jsonschema.Draft202012Validator(schema).iter_errors(tomllib.loads(text))
    return sorted(".".join(map(str, fault.absolute_path)) for fault in found)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_fulfils_the_schema(schema, name):
    jsonschema.Draft202012Validator(schema).validate(load_config(preset=name).as_dict())


@pytest.mark.parametrize(
    "text",
    [
        "",
        'extends = "mock"\n[photo]\nmax_side = 640',
        'extends = "../base.toml"\n[engine]\npreset = "paper"\n[engine.joint.optimiser]\nsteps = '
        "40",
        '[inpainter]\nbackend = "telea"\noptions = {radius_px = 3.0}',
        '[inpainter]\nbackend = "physic-opencv:telea"\noptions = {radius_px = 3.0}',
        '[inpainter]\nbackend = "my_pkg.fill:Fill"\noptions = {anything = 1}',
        '[hand_estimator]\nbackend = "none"',
        "[inpainter]\noptions = {radius_px = 3.0}",
    ],
)
def test_a_valid_config_fulfils_the_schema(schema, text):
    assert faults(schema, text) == []


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("[photo]\nmax_sid = 640", "photo"),
        ("[photo]\nmax_side = 3", "photo.max_side"),
        ('[inpainter]\nbackend = "telea"\noptions = {radius = 3.0}', "inpainter.options"),
        (
            '[inpainter]\nbackend = "telea"\noptions = {radius_px = 99}',
            "inpainter.options.radius_px",
        ),
        (
            '[inpainter]\nbackend = "physic-opencv:telea"\noptions = {radius_px = 99}',
            "inpainter.options.radius_px",
        ),
        ('[inpainter]\nbackend = "telae"', "inpainter.backend"),
        ('[segmenter]\nbackend = "none"', "segmenter.backend"),
        ('[engine]\npreset = "papr"', "engine.preset"),
        ("[engine.scene]\nfar_m = 'x'", "engine.scene.far_m"),
        ("[engine.scene]\nfar = 3", "engine.scene"),
        ('extends = "embeded"', "extends"),
        ("[run]\ndevice = 'gpu'", "run.device"),
        ("colour = 3", ""),
    ],
)
def test_a_mistake_is_found_where_it_is(schema, text, path):
    assert faults(schema, text) == [path]


def test_a_backend_that_cannot_be_read_is_listed_without_options(site):
    site.install("physic-broken", "", entry="broken = no_such_module:C", group="physic.inpainter")
    schema = config_schema()
    assert faults(schema, '[inpainter]\nbackend = "broken"\noptions = {a = 1}') == []
    assert faults(schema, '[inpainter]\nbackend = "other"') == ["inpainter.backend"]
