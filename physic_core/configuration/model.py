"""The validated configuration: a pydantic model of its tables, and its loading from files,
variables and flags.

This module checks structure, keys, types and the settings of the engine, without plugins.
:mod:`physic_core.configuration.resolve` then checks the options of each backend.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, get_origin, get_type_hints

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    Strict,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from physic_core.backends.devices import DEVICE_PATTERN
from physic_core.configuration.layers import (
    SettingsLayer,
    environment_layers,
    file_layers,
    is_config_path,
    merge_layers,
    override_layers,
    preset_layers,
    source_of,
)
from physic_core.configuration.problems import Problem, config_error, problems_from_pydantic
from physic_core.discovery.catalog import ENGINE_PRESETS
from physic_core.discovery.hooks import PluginItem
from physic_core.discovery.plugins import FoundRecord, find_item, find_items, import_item
from physic_core.engine.settings import EngineSettings, with_overrides
from physic_core.errors import ConfigError, PluginError
from physic_core.files.text import path_problem, quoted
from physic_core.interfaces import INTERFACES
from physic_core.interfaces.backend import StrictModel
from physic_core.types import KnownLength, KnownSizes

DEFAULT_PRESET = "embedded"
OPTIONAL_INTERFACES = ("hand_estimator", "person_observer", "contact_prior")
"""Interfaces that a configuration may omit with ``backend = "none"``."""

_FROM_FILE = "file"
"""Name of the backends that read a result from the user's file in their option ``path``."""
_UNITS_M = {"mm": 0.001, "cm": 0.01, "m": 1.0, "ft": 0.3048}
_PNG_UNIT = "mm"  # of depth cameras
_MAX_PROMPTS = 1000  # people or lengths; a photo that can be reconstructed has tens
_HOOK = "physic_engine_presets"
DEFAULT_ENERGY = "default"
"""Name of the core's preset."""


class _StrictTable(StrictModel):
    model_config = ConfigDict(strict=True)


def _absolute_path(path: str) -> str:
    if problem := path_problem(path):
        raise ValueError(problem)
    return os.path.abspath(os.path.expanduser(path))


_FilePath = Annotated[str, AfterValidator(_absolute_path)] | None


class BackendChoice(StrictModel):
    """The table of one interface, such as ``[metric_depth]``: a backend and its options."""

    backend: str = Field(
        min_length=1,
        description="name of a backend, 'distribution:name', 'package.module:Class' (a module "
        "beside the config, "
        "or an installed one), or 'none' where it is optional",
    )
    options: dict[str, Any] = Field(default_factory=dict, description="the backend's own options")


def _depth_unit(text: str) -> str:
    if text not in _UNITS_M and not re.fullmatch(r"1/[1-9]\d{0,5}", text):
        raise ValueError(
            f"should be {', '.join(_UNITS_M)}, or a part of a meter such as 1/5000 (got "
            f"{quoted(text)})"
        )
    return text


_DepthUnit = Annotated[str, AfterValidator(_depth_unit)]


_Pixel = Annotated[float, Field(ge=-1e6, le=1e6)]  # beyond, float32 cannot tell neighbouring pixels
_Focal = Annotated[float, Field(ge=1, le=1e6)]  # px; a field of view of 180 or 0 degrees
_Length = Annotated[float, Field(ge=0.01, le=1000)]  # meters
# Strong lenses of telephones have coefficients of tens.
_Distortion = Annotated[float, Field(ge=-1000, le=1000)]


class PhotoSettings(StrictModel):
    """The table ``[photo]``: camera of the photo, its size for the pipeline, and the people to
    reconstruct.
    """

    max_side: int = Field(
        default=1280,
        ge=128,
        le=10_000,
        description="larger photos are downscaled to this long side, px; 640-1920",
    )
    focal_px: float | None = Field(
        default=None, ge=1, le=1e6, description="focal length, px of the upright photo file"
    )
    intrinsics: tuple[_Focal, _Focal, _Pixel, _Pixel] | None = Field(
        default=None,
        description="fx, fy, cx, cy, px of the upright photo file, pixel centers at integers",
    )
    distortion: tuple[_Distortion, _Distortion, _Distortion, _Distortion, _Distortion] | None = (
        Field(
            default=None,
            description="lens distortion k1, k2, p1, p2, k3 of the intrinsics, in OpenCV's order",
        )
    )
    person: tuple[tuple[_Pixel, _Pixel], ...] = Field(
        default=(),
        max_length=_MAX_PROMPTS,
        description="a pixel x, y on each person to reconstruct, px of the upright photo file",
    )
    box: tuple[tuple[_Pixel, _Pixel, _Pixel, _Pixel], ...] = Field(
        default=(),
        max_length=_MAX_PROMPTS,
        description="x0, y0, x1, y1 around each person to reconstruct, px of the upright photo "
        "file",
    )
    ignore: tuple[tuple[_Pixel, _Pixel], ...] = Field(
        default=(),
        max_length=_MAX_PROMPTS,
        description="a pixel x, y on each person to leave out, such as a reflection, px of the "
        "upright photo file",
    )
    depth: _FilePath = Field(
        default=None,
        description="a depth map of the photo, instead of metric_depth: .npy, .exr or .pfm in "
        "meters, or a 16-bit PNG in millimeters; relative to the config file",
    )
    depth_unit: _DepthUnit | None = Field(
        default=None,
        description="another unit of depth: mm, cm, m, ft, or a part of a meter such as 1/5000",
    )
    pointmap: _FilePath = Field(
        default=None,
        description="a point map of the photo, instead of relative_pointmap: .npy (H, W, 3), or "
        ".npz with points and "
        "valid; relative to the config file",
    )
    keypoints: _FilePath = Field(
        default=None,
        description="keypoints that replace detected ones, px of the upright photo file: .csv "
        "with person, joint, x, "
        "y, or COCO .json; relative to the config file",
    )
    bodies: _FilePath = Field(
        default=None,
        description="bodies of people by another program, instead of body_estimator's: an .npz of "
        "physic export --to bodies, or a file of docs/bodies.md; relative to the config file",
    )
    bodies_model: _FilePath = Field(
        default=None,
        description="the SMPL, SMPL-H, SMPL-X or MHR file that bodies are of, where they are not "
        "those of body_model; relative to the config file",
    )
    bodies_frame: int | None = Field(
        default=None,
        ge=0,
        le=10_000_000,
        description="frame of a film whose bodies are used, from 0",
    )
    bodies_sigma: float | None = Field(
        default=None,
        ge=0.001,
        le=1,
        description="root mean square error of joints of bodies relative to the pelvis, meters; "
        "by default 0.06, and more for tools that a public table says are worse",
    )
    bodies_final: bool = Field(
        default=False,
        description="whether the given bodies are all the people, with unchanged poses and shapes",
    )
    masks: _FilePath = Field(
        default=None,
        description="masks of people, instead of segmenter's, px of the upright photo file: COCO "
        ".json, label .png, .npz (N, H, W), a folder of SAM's masks, or a .txt of polygons; "
        "relative to the config file",
    )
    require_people: bool = Field(
        default=False,
        description="whether a photo without people is an error rather than a scene-only result",
    )
    stature: tuple[Annotated[float, Field(ge=0, le=2.6)], ...] | None = Field(
        default=None,
        max_length=_MAX_PROMPTS,
        description="known standing heights, meters: one for all people, or one per person from "
        "left to right, or in "
        "the order of the chosen people; 0 where unknown",
    )
    age: tuple[Annotated[float, Field(ge=0, le=120)], ...] | None = Field(
        default=None,
        max_length=_MAX_PROMPTS,
        description="known ages, years: one for all people, or one per person as in stature; 0 "
        "where unknown",
    )
    camera_height: float | None = Field(
        default=None,
        ge=0.01,
        le=100,
        description="known height of the camera above the floor, meters",
    )
    known_length: tuple[tuple[_Pixel, _Pixel, _Pixel, _Pixel, _Length], ...] | None = Field(
        default=None,
        max_length=_MAX_PROMPTS,
        description="x1, y1, x2, y2, meters: two pixels of the upright photo file, and the true "
        "distance between "
        "their points; or a list of these",
    )
    mask_growth: float = Field(
        default=0.008,
        ge=0,
        le=0.1,
        description="dilation of the people's masks before inpainting, as a share of the long side",
    )

    @field_validator("stature", "age", mode="before")
    @classmethod
    def _list_of_numbers(cls, value: Any, info: ValidationInfo) -> Any:
        values = (value,) if type(value) in (int, float) else value
        if isinstance(values, (list, tuple)) and all(type(each) in (int, float) for each in values):
            fields_given: dict[str, Any] = {str(info.field_name): tuple(values)}
            KnownSizes(**fields_given)  # whose message states the unit
        return values

    @field_validator("camera_height", mode="before")
    @classmethod
    def _height_in_meters(cls, value: Any) -> Any:
        if type(value) in (int, float):
            KnownSizes(camera_height=value)
        return value

    @field_validator("known_length", mode="before")
    @classmethod
    def _list_of_lengths(cls, value: Any) -> Any:
        is_list = isinstance(value, (list, tuple)) and value
        values = (value,) if is_list and type(value[0]) in (int, float) else value
        for each in values if is_list else ():
            numbers = each if isinstance(each, (list, tuple)) else ()
            if len(numbers) == 5 and all(type(x) in (int, float) for x in numbers):
                KnownSizes(lengths=(KnownLength((*each[:2],), (*each[2:4],), each[4]),))
        return values

    def known_sizes(self, given: KnownSizes | None = None) -> KnownSizes:
        """Return the known sizes, in px of the upright photo file; unset ones default to
        ``given``.
        """
        stated: dict[str, Any] = {
            name: value
            for name in ("stature", "camera_height", "age")
            if (value := getattr(self, name)) is not None
        }
        if self.known_length is not None:
            stated["lengths"] = tuple(
                KnownLength((a, b), (c, d), meters) for a, b, c, d, meters in self.known_length
            )
        return replace(given or KnownSizes(), **stated)

    @model_validator(mode="after")
    def _one_camera_and_valid_sizes(self) -> PhotoSettings:
        self.known_sizes()  # raises ValueError
        if self.focal_px is not None and self.intrinsics is not None:
            raise ValueError("has both focal_px and intrinsics: give only one")
        if self.ignore and (self.person or self.box):
            raise ValueError("has chosen people and ignored ones: give only one of them")
        if self.depth_unit is not None and self.depth is None:
            raise ValueError("has depth_unit without depth: give both")
        about_bodies = self.bodies_model, self.bodies_frame
        if self.bodies is None and any(each is not None for each in about_bodies):
            raise ValueError("has bodies_model or bodies_frame without bodies: give bodies, too")
        if self.masks is not None and (self.person or self.box or self.ignore):
            raise ValueError("has masks and chosen or ignored people: give only one of them")
        if self.distortion is not None and self.intrinsics is None:
            raise ValueError(
                "has distortion without intrinsics: give both, from the same calibration"
            )
        if any(self.distortion or ()) and (self.depth or self.pointmap):
            raise ValueError(
                "has distortion and a map of the distorted photo: undistort both first, and leave "
                "it out"
            )
        return self


class BodyModelChoice(StrictModel):
    """The table ``[body_model]``: the embedded body, or an SMPL-X file of the user."""

    name: Literal["embedded"] | None = Field(
        default=None, description="the body that PhySIC contains"
    )
    path: _FilePath = Field(
        default=None, description="an official SMPLX_*.npz; relative to the config file"
    )

    @model_validator(mode="after")
    def _one_body(self) -> BodyModelChoice:
        if self.name is not None and self.path is not None:
            raise ValueError("has both name and path: give only one")
        return self

    @property
    def source(self) -> str:
        """Name or path of the body model, for :func:`physic_core.body.load_body`."""
        return self.path or "embedded"


class EngineChoice(StrictModel):
    """The table ``[engine]``: a preset of the engine, and settings of each stage that override the
    preset.
    """

    preset: str = Field(default="default", description="preset of engine settings")
    scene: dict[str, Any] = Field(default_factory=dict, description="stage 1: scene, camera, floor")
    placement: dict[str, Any] = Field(
        default_factory=dict, description="stage 2: each body aligned with its points"
    )
    joint: dict[str, Any] = Field(default_factory=dict, description="stage 3: joint optimization")
    contact: dict[str, Any] = Field(default_factory=dict, description="the contact map")

    def settings(self) -> EngineSettings:
        """Return the settings of the preset with the overrides applied."""
        changed = {
            stage: table.model_validate(getattr(self, stage)).model_dump(exclude_unset=True)
            for stage, table in stage_models(self.preset).items()
        }
        return with_overrides(engine_preset(self.preset), changed)


class RunSettings(StrictModel):
    """The table ``[run]``: device, threads, memory and cache."""

    device: str = Field(
        default="cpu",
        description="where the networks run: 'cpu', 'cuda' or 'cuda:N'; the engine stays on the "
        "CPU",
    )
    threads: int = Field(
        default=1,
        ge=1,
        le=256,
        description="CPU threads of engine and fits; more than 1 is rarely faster and can change "
        "the last bits",
    )
    low_memory: bool = Field(
        default=False, description="close each backend right after its last use"
    )
    cache: bool = Field(
        default=True, description="cache backend outputs, and reuse those of earlier runs"
    )
    cache_mb: int = Field(
        default=2000, ge=0, le=1_000_000_000, description="maximum size of the cache, megabytes"
    )

    @field_validator("device")
    @classmethod
    def _is_device(cls, value: str) -> str:
        if not DEVICE_PATTERN.fullmatch(value):
            raise ValueError(f"{value!r} is not a device: use cpu, cuda or cuda:N")
        return value


class Config(StrictModel):
    """A complete, validated configuration, created by :func:`load_config`."""

    segmenter: BackendChoice
    inpainter: BackendChoice
    metric_depth: BackendChoice
    relative_pointmap: BackendChoice
    keypoint_detector: BackendChoice
    body_estimator: BackendChoice
    hand_estimator: BackendChoice = BackendChoice(backend="none")
    person_observer: BackendChoice = BackendChoice(backend="none")
    contact_prior: BackendChoice = BackendChoice(backend="none")
    photo: PhotoSettings = PhotoSettings()
    body_model: BodyModelChoice = BodyModelChoice()
    engine: EngineChoice = EngineChoice()
    run: RunSettings = RunSettings()

    _sources: dict[str, str] = PrivateAttr(default_factory=dict)

    @field_validator(*(name for name in INTERFACES if name not in OPTIONAL_INTERFACES))
    @classmethod
    def _is_named(cls, choice: BackendChoice) -> BackendChoice:
        if choice.backend == "none":
            raise ValueError(
                f"should name a backend: only {', '.join(OPTIONAL_INTERFACES)} may be 'none'"
            )
        return choice

    def choice(self, interface: str) -> BackendChoice:
        """Return the backend and options chosen for an interface; a file of ``[photo]`` replaces
        both.

        Options of a chosen backend that reads files are kept.
        """
        chosen: BackendChoice = getattr(self, interface)
        path = {"metric_depth": self.photo.depth, "relative_pointmap": self.photo.pointmap}.get(
            interface
        )
        if path is None:
            return chosen
        options: dict[str, Any] = {"path": path}
        is_kept = chosen.backend.rpartition(":")[2] == _FROM_FILE
        if interface == "metric_depth":
            usual = _PNG_UNIT if path.lower().endswith(".png") and not is_kept else None
            unit = self.photo.depth_unit or usual
            if unit:
                unit_m = _UNITS_M.get(unit)
                options |= {"scale": unit_m or 1 / int(unit.removeprefix("1/"))}
        return BackendChoice(
            backend=_FROM_FILE, options={**(chosen.options if is_kept else {}), **options}
        )

    def input_files(self) -> dict[str, str]:
        """Return the files that a run reads beside photo, weights and body model, by the setting
        that names each.
        """
        files = {
            f"photo.{name}": getattr(self.photo, name)
            for name in ("depth", "pointmap", "keypoints", "bodies", "bodies_model", "masks")
        }
        for interface in INTERFACES:
            chosen: BackendChoice = getattr(self, interface)
            if chosen == self.choice(interface) and chosen.backend.rpartition(":")[2] == _FROM_FILE:
                files[f"{interface}.options.path"] = chosen.options.get("path")
        return {name: str(path) for name, path in files.items() if path is not None}

    def with_backends(self, chosen: Mapping[str, tuple[str, Mapping[str, Any]]]) -> Config:
        """Return a copy with other backends; ``chosen`` maps interfaces to a backend's name and
        options.
        """
        return self.model_copy(
            update={
                n: BackendChoice(backend=name, options=dict(options))
                for n, (name, options) in chosen.items()
            }
        )

    def with_photo(self, settings: Mapping[str, Any]) -> Config:
        """Return a copy with other values in the table ``[photo]``.

        Raises:
            ConfigError: a value is invalid; the message lists all errors.
        """
        own = "settings of this photo"
        changed = _validate_layers([("config", self.as_dict()), (own, {"photo": settings})])
        copy = self.model_copy(update={"photo": changed.photo})
        changes = {path: label for path, label in changed._sources.items() if label == own}
        copy._sources = {**self._sources, **changes}
        return copy

    def source(self, path: str) -> str:
        """Return the source of the value at a dotted path: a file, a flag, "preset embedded" or
        "default".
        """
        return source_of(self._sources, path)

    def as_dict(self) -> dict[str, Any]:
        """Convert to nested dictionaries, as in a TOML file, without unset values and with absolute
        paths.
        """
        return self.model_dump(mode="json", exclude_none=True)


def load_config(
    file: str | os.PathLike[str] | None = None,
    *,
    preset: str | None = None,
    overrides: Sequence[str] = (),
    flags: Mapping[str, Mapping[str, Any]] | None = None,
    environment: Mapping[str, str] | None = None,
) -> Config:
    """Read, merge and validate a configuration.

    Args:
        file: a TOML file, which may extend a preset or another file with ``extends``; or the
            ``reconstruction.json`` of a run, to repeat it.
        preset: the preset to use without a file, or with a file that has no ``extends``.
        overrides: strings "a.b=c"; c is TOML, or a string without quotes.
        flags: flag -> the tables that it sets, such as ``{"--focal-px": {"photo": {"focal_px":
            900.0}}}``.
        environment: variables such as ``PHYSIC__INPAINTER__BACKEND=telea``, which override the
            file; ``overrides`` override them. None for ``os.environ``.

    Raises:
        ConfigError: the configuration is invalid; the message lists all errors.
    """
    base = preset or DEFAULT_PRESET
    layers = [
        *(preset_layers(base) if file is None else file_layers(file, base)),
        *environment_layers(os.environ if environment is None else environment),
        *override_layers(overrides),
        *(flags or {}).items(),
    ]
    return _validate_layers(layers)


def as_config(config: Config | str | os.PathLike[str] | Mapping[str, Any] | None) -> Config:
    """Convert a preset name, path, mapping, Config or None to a Config.

    A string is the name of a preset unless it ends in ".toml" or ".json" or contains a slash. A
    mapping overrides the preset or file that its key "extends" names, or the default preset.

    Raises:
        ConfigError: the configuration is invalid; the message lists all errors.
    """
    if isinstance(config, Config):
        return config
    tables = dict(config) if isinstance(config, Mapping) else {"extends": config}
    base = tables.pop("extends", None)
    if not (base is None or isinstance(base, str | os.PathLike)):
        raise ConfigError(
            f"a config should be a preset, a path, a mapping or a Config (got {quoted(base)})"
        )
    if isinstance(base, str) and not is_config_path(base):
        return load_config(preset=base, flags={"config": tables})
    return load_config(base, flags={"config": tables})


def _validate_layers(layers: Iterable[SettingsLayer]) -> Config:
    """Merge layers and validate the result, or raise one ConfigError with all problems."""
    merged, sources = merge_layers(layers)
    problems = _engine_problems(merged.get("engine"))
    try:
        config = Config.model_validate(merged)
    except ValidationError as error:
        problems = problems_from_pydantic(error, Config) + problems
    if problems:
        raise config_error(problems, lambda path: source_of(sources, path, "config"))
    config._sources = sources
    return config


def _engine_problems(engine: Any) -> list[Problem]:
    """Return the problems of the engine's preset name and of its overrides."""
    preset = engine.get("preset", DEFAULT_ENERGY) if isinstance(engine, dict) else None
    if not isinstance(preset, str):
        return []
    try:
        if preset != DEFAULT_ENERGY:
            _find(preset)  # which imports nothing
    except ConfigError as error:
        return [Problem("engine.preset", str(error))]
    tables = {stage: table for stage, table in engine.items() if table and isinstance(table, dict)}
    problems = []
    for stage, model in stage_models(preset).items() if tables else ():
        try:
            model.model_validate(tables.get(stage, {}))
        except ValidationError as error:
            problems += problems_from_pydantic(error, model, f"engine.{stage}", "setting")
    return problems


@cache
def stage_models(preset: str) -> dict[str, type[StrictModel]]:
    """Return a pydantic model of the settings of each stage; ``preset`` determines the terms of the
    joint stage.

    All keys are optional. Strings are not converted to numbers.
    """
    settings = engine_preset(preset)
    return {f.name: settings_model(type(getattr(settings, f.name))) for f in fields(settings)}  # type: ignore[arg-type]


@cache
def settings_model(kind: Any) -> type[StrictModel]:
    """Build a pydantic model from a dataclass of settings; nested dataclasses become nested
    models.
    """
    hints = get_type_hints(kind, include_extras=True)
    own = {f.name: hints[f.name] for f in fields(kind)}
    kinds = {n: settings_model(h) if is_dataclass(h) else h for n, h in own.items()}  # type: ignore[arg-type]
    keys: dict[str, Any] = {
        name: (_accepting_list(hint) | None, None) for name, hint in kinds.items()
    }
    return create_model(kind.__name__, __base__=_StrictTable, **keys)


def _accepting_list(hint: Any) -> Any:
    """Make a tuple annotation accept a list, as TOML has no tuples."""
    kind = hint.__origin__ if get_origin(hint) is Annotated else hint
    return Annotated[hint, Strict(False)] if get_origin(kind) is tuple else hint


def engine_preset_names() -> tuple[str, ...]:
    """Return the names of the core's preset and of those of installed plugins, sorted."""
    return tuple(sorted({DEFAULT_ENERGY, *(preset.record.name for preset in find_items(_HOOK))}))


def engine_preset(name: str = DEFAULT_ENERGY) -> EngineSettings:
    """Return the settings of the engine of a preset, such as "default".

    Raises:
        ConfigError: no preset has this name, or several plugins offer it.
        PluginError: the plugin cannot be imported, or names no settings.
    """
    # The terms of stage 3 import torch, which a configuration without engine settings does not
    # need.
    from physic_core.engine.presets import DEFAULT
    from physic_core.engine.settings import EngineSettings

    if name == DEFAULT_ENERGY:
        return DEFAULT
    record = _find(name)
    settings = import_item(record, "engine preset")
    if not isinstance(settings, EngineSettings):
        raise PluginError(
            f"{record.title('engine preset')} should be an EngineSettings, got "
            f"{type(settings).__name__}"
        )
    return settings


def _find(name: str) -> FoundRecord[PluginItem]:
    return find_item(_HOOK, name, "engine preset", own=DEFAULT_ENERGY, known=ENGINE_PRESETS)
