"""Whoever registers our names with an index gets nothing installed by the documented commands."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.slow

NAMES = ("metricbody", "metricbody-embedded", "metricbody-testing", "metricbody-visual")
PROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
[project]
name = "{name}"
version = "{version}"
dependencies = {dependencies}
[tool.hatch.build.targets.wheel]
packages = ["{module}"]
"""


def package(folder, name, version, dependencies=()):
    module = name.replace("-", "_")
    (folder / module).mkdir(parents=True)
    (folder / module / "__init__.py").write_text("raise SystemExit('code of a stranger')\n")
    text = PROJECT.format(
        name=name, version=version, module=module, dependencies=list(dependencies)
    )
    (folder / "pyproject.toml").write_text(text)
    return folder


@pytest.fixture
def strangers(tmp_path, build):
    """Wheels with our names and a higher version, as an index could offer them."""
    return [build(package(tmp_path / name, name, "9.9")) for name in NAMES]


def versions(environment, folder):
    code = "from importlib.metadata import version; print(*map(version, {names!r}))"
    return environment.run(f'python -c "{code.format(names=NAMES)}"', folder).split()


@pytest.mark.parametrize("own", [False, True], ids=["ours", "beside a project of the user"])
def test_our_wheels_by_path_are_installed_whatever_an_index_offers(
    environment, wheels, strangers, tmp_path, own
):
    paths = [str(wheels / "*.whl")]
    if own:
        project = package(tmp_path / "mine", "mine", "1.0", NAMES[:2])
        paths.append(str(project))
    offered = strangers[0].parent
    environment.run(f"pip install -q --find-links {offered} {' '.join(paths)}", tmp_path)
    assert versions(environment, tmp_path) == ["0.1.0"] * len(NAMES)
