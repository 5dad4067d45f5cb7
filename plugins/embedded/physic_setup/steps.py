"""The steps that make a configuration run on this machine: packages, weights, code, files of the
user, a config.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from physic_core import engine_preset_names
from physic_core.cache import cache_folder, users_cache
from physic_core.configuration.layers import file_layers, merge_layers, preset_layers
from physic_core.configuration.model import load_config
from physic_core.configuration.resolve import named_weights, resolve
from physic_core.discovery.backends import find_backend
from physic_core.discovery.catalog import BACKENDS, ENGINE_PRESETS, sources_in_checkout
from physic_core.errors import BackendNotFoundError, ConfigError
from physic_core.interfaces import INTERFACES, GpuMemory, Packages, Repository, UserFile
from physic_core.weights import locate_files
from physic_networks.checkouts import NON_COMMERCIAL, PIP_NAMES

if TYPE_CHECKING:
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.weights import WeightSet

_Kind = TypeVar("_Kind")


@dataclass(frozen=True)
class SetupStep:
    """One step.

    Attributes:
        title: what it is for.
        is_done: whether nothing of it is left.
        commands: shell commands that need no decision of the user.
        by_hand: lines about what only the user can do: accept a licence, register, choose a file.
        file: path and text of a file to write.
    """

    title: str
    is_done: bool
    commands: tuple[str, ...] = ()
    by_hand: tuple[str, ...] = ()
    file: tuple[Path, str] | None = None


@dataclass(frozen=True)
class Setup:
    """All steps, and their costs.

    Attributes:
        steps: in their order.
        download_bytes: of the missing files whose size is published.
        unsized: missing weights and files of whose size no exact number is published.
        gpu: memory of a GPU that backends state, by backend.
        gpu_unknown: backends of a "cuda" configuration that state none.
        accounts: web addresses that ask for an account, of what is missing.
        unpinned: files and repositories that have neither a hash nor a revision.
        pinned: number of the others.
        keeps_graphs: whether networks on the CPU can be kept as optimised for this processor.
    """

    steps: tuple[SetupStep, ...]
    download_bytes: int = 0
    unsized: tuple[str, ...] = ()
    gpu: tuple[tuple[str, GpuMemory], ...] = ()
    gpu_unknown: tuple[str, ...] = ()
    accounts: tuple[str, ...] = ()
    unpinned: tuple[str, ...] = ()
    pinned: int = 0
    keeps_graphs: bool = False


def read_config(file: Path, preset: str) -> tuple[Config, tuple[str, ...]]:
    """Return the configuration of an earlier setup or of a preset, and the missing distribution of
    its engine preset.

    Without that distribution, the configuration has the engine preset "default".

    Raises:
        ConfigError: the configuration is invalid for another reason.
    """
    read = partial(load_config, file) if file.is_file() else partial(load_config, preset=preset)
    try:
        return read(), ()
    except ConfigError:
        tables, _ = merge_layers(
            file_layers(file, preset) if file.is_file() else preset_layers(preset)
        )
        engine = tables.get("engine", {}).get("preset")
        if engine in engine_preset_names() or engine not in ENGINE_PRESETS:
            raise
        return read(flags={"physic setup": {"engine": {"preset": "default"}}}), (
            ENGINE_PRESETS[engine],
        )


def setup_steps(config: Config, preset: str, folder: Path, missing: tuple[str, ...] = ()) -> Setup:
    """Return the steps for a configuration.

    Args:
        config: of the preset, or of the file that an earlier setup wrote.
        missing: distributions that the configuration needs other than for a backend.
        preset: that the written configuration extends.
        folder: for checkouts, files of the user and the configuration.

    Raises:
        ConfigError: names or options are invalid.
        BackendError: a backend is broken, or the manifest of a plugin is invalid.
    """
    if uninstalled := (*missing, *_uninstalled(config)):
        return Setup((_plugins_step(uninstalled),))
    plan = resolve(config)
    sets = named_weights(plan)
    repositories = _unique_requirements(plan, Repository)
    files = _unique_requirements(plan, UserFile)
    absent = {file for _, file in files if not file.is_here}
    sizes = [*_missing_weights(sets), *((file.name, file.bytes) for file in absent)]
    accounts = [*_accounts(sets), *(file.account for file in absent if file.account)]
    gpu = _unique_requirements(plan, GpuMemory)
    unpinned = _unpinned(sets, repositories)
    steps = (
        _packages_step(plan),
        _free_weights_step(sets),
        _repositories_step(repositories, folder),
        *(_restricted_weights_step(weights) for weights in sets if not _is_downloadable(weights)),
        *(_user_file_step(file, folder) for file in dict.fromkeys(file for _, file in files)),
        _config_file_step(preset, folder, [*repositories, *files]),
    )
    return Setup(
        steps=tuple(step for step in steps if step is not None),
        download_bytes=sum(size for _, size in sizes if size is not None),
        unsized=tuple(dict.fromkeys(name for name, size in sizes if size is None)),
        gpu=tuple(gpu),
        gpu_unknown=tuple(name for name in plan.backends if name not in dict(gpu))
        if plan.device != "cpu"
        else (),
        accounts=tuple(dict.fromkeys(accounts)),
        unpinned=unpinned,
        pinned=sum(len(weights.files) for weights in sets) + len(repositories) - len(unpinned),
        keeps_graphs=plan.device == "cpu" and users_cache("graphs") is not None,
    )


def _plugins_step(distributions: tuple[str, ...]) -> SetupStep:
    install = f"python -m pip install{_constraints()}"
    return SetupStep(
        "Plugins of the preset; then run the same command again for the other steps",
        False,
        tuple(f"{install} {_source(name)}" for name in distributions),
    )


def _accounts(sets: tuple[WeightSet, ...]) -> Iterator[str]:
    """Yield the web address of each missing set that needs an account."""
    for weights in sets:
        if weights.needs_account and not _is_complete(weights):
            yield weights.homepage


def _missing_weights(sets: tuple[WeightSet, ...]) -> Iterator[tuple[str, int | None]]:
    """Yield the set of each missing file, and its bytes if they are published."""
    for weights in sets:
        here = locate_files(weights)
        yield from ((weights.name, file.bytes) for file in weights.files if file.path not in here)


def _unpinned(
    sets: tuple[WeightSet, ...], repositories: list[tuple[str, Repository]]
) -> tuple[str, ...]:
    """Return the files and repositories that have neither a hash nor a revision."""
    files = (
        f"{weights.name}/{file.path}"
        for weights in sets
        for file in weights.files
        if not file.is_pinned
    )
    return (*files, *(one.url for _, one in repositories if not one.commit))


def _unique_requirements(plan: ResolvedPipeline, kind: type[_Kind]) -> list[tuple[str, _Kind]]:
    """Return the requirements of one kind, with their interfaces; a repository or file of two
    backends is in both.
    """
    return [
        (interface, one)
        for interface, resolved in plan.backends.items()
        for one in resolved.backend.requirements()
        if isinstance(one, kind)
    ]


def _uninstalled(config: Config) -> tuple[str, ...]:
    """Return the known distributions that the configuration names and that are not installed."""
    names = []
    for interface in INTERFACES:
        name = config.choice(interface).backend
        if name == "none":
            continue
        try:
            find_backend(interface, name)
        except BackendNotFoundError:
            owner, _, bare = name.rpartition(":")
            if distribution := owner or BACKENDS.get(bare):
                names.append(distribution)
    return tuple(dict.fromkeys(names))


def _source(distribution: str) -> str:
    """Return what pip installs a distribution from: a folder of the checkout of PhySIC, or its
    name.
    """
    root = _checkout_root() or Path()
    folders = sources_in_checkout(distribution)
    return " ".join(f"-e {shlex.quote(str(root / folder))}" for folder in folders) or shlex.quote(
        distribution
    )


def _checkout_root() -> Path | None:
    """Return the checkout that PhySIC is installed from, or None."""
    import physic_core

    root = Path(physic_core.__file__).resolve().parent.parent
    return root if (root / "constraints.txt").is_file() else None


def _constraints() -> str:
    root = _checkout_root()
    return f" -c {shlex.quote(str(root / 'constraints.txt'))}" if root else ""


def _packages_step(plan: ResolvedPipeline) -> SetupStep | None:
    modules = sorted(
        {module for _, one in _unique_requirements(plan, Packages) for module in one.modules}
    )
    lacking = [PIP_NAMES.get(module, module) for module in modules if find_spec(module) is None]
    if not modules:
        return None
    install = f"python -m pip install{_constraints()}"
    free = [name for name in lacking if name not in {*NON_COMMERCIAL, "torchvision"}]
    return SetupStep(
        f"Python packages ({len(modules)})",
        not lacking,
        (
            *((f"{install} {shlex.join(free)}",) if free else ()),
            *(_torchvision(install) if "torchvision" in lacking else ()),
        ),
        tuple(f"no commercial use: {install} {name}" for name in lacking if name in NON_COMMERCIAL),
    )


def _torchvision(install: str) -> tuple[str, ...]:
    """Return the commands that install torchvision in the build of the installed torch; uv knows
    its index.
    """
    import torch

    number, _, build = torch.__version__.partition("+")
    if not build:
        return (f"{install} torch=={number} torchvision",)
    return (
        f"{install} uv",
        f"python -m uv pip install --torch-backend {build} torch=={number} torchvision",
    )


def _is_complete(weights: WeightSet) -> bool:
    return len(locate_files(weights)) == len(weights.files)


def _is_downloadable(weights: WeightSet) -> bool:
    """Return whether a set needs no decision of the user."""
    return weights.is_free and all(file.source for file in weights.files)


def _free_weights_step(sets: tuple[WeightSet, ...]) -> SetupStep | None:
    free = [weights for weights in sets if _is_downloadable(weights)]
    if not free:
        return None
    lacking = [weights.name for weights in free if not _is_complete(weights)]
    commands = (f"physic weights fetch {shlex.join(lacking)}",) if lacking else ()
    licences = ", ".join(f"{weights.name} ({weights.license})" for weights in free)
    return SetupStep(f"Weights without restrictions: {licences}", not lacking, commands)


def _restricted_weights_step(weights: WeightSet) -> SetupStep:
    title = f"Weights '{weights.name}': {weights.license}"
    if _is_complete(weights):
        return SetupStep(title, True)
    by_hand = [file.path for file in weights.files if not file.source]
    place = cache_folder("weights")
    into = (
        (f"put {', '.join(by_hand)} into {place / weights.name}",)
        if by_hand and place is not None
        else ()
    )
    return SetupStep(
        title, False, by_hand=(f"license: {weights.homepage}", weights.how_to_get(), *into)
    )


def _repositories_step(
    repositories: list[tuple[str, Repository]], folder: Path
) -> SetupStep | None:
    commands = []
    for one in {_checkout_folder(one, folder): one for _, one in repositories}.values():
        if not one.is_here:
            place = shlex.quote(str(_checkout_folder(one, folder)))
            if not _checkout_folder(one, folder).is_dir():
                commands.append(f"git clone {one.url} {place}")
            if one.commit:
                commands.append(f"git -C {place} checkout --quiet {one.commit}")
    return (
        SetupStep("Code of the estimators", not commands, tuple(commands)) if repositories else None
    )


def _checkout_folder(repository: Repository, folder: Path) -> Path:
    return (
        Path(repository.folder)
        if repository.folder
        else folder / repository.url.rstrip("/").rpartition("/")[2]
    )


def _user_file_step(file: UserFile, folder: Path) -> SetupStep:
    into = (f"put it at {folder / file.name}",) if file.option else ()
    return SetupStep(file.name, file.is_here, by_hand=() if file.is_here else (file.advice, *into))


def _config_file_step(
    preset: str, folder: Path, options: list[tuple[str, Repository | UserFile]]
) -> SetupStep:
    path = folder / f"{preset}.toml"
    tables: dict[str, dict[str, str]] = {interface: {} for interface, _ in options}
    for interface, one in options:
        if isinstance(one, Repository) and (one.folder or not one.is_here):
            tables[interface][one.option] = str(_checkout_folder(one, folder))
        elif isinstance(one, UserFile) and one.option:
            tables[interface][one.option] = str(folder / one.name)
    lines = [f'extends = "{preset}"']
    for interface, values in tables.items():
        if values:
            lines += ["", f"[{interface}.options]"]
        for key, value in values.items():
            lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
    return SetupStep("Configuration", path.is_file(), file=(path, "\n".join(lines) + "\n"))
