from __future__ import annotations

import gc
import os
import signal
import socket
import subprocess
import sys
from functools import cache, partial, partialmethod
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner
from hypothesis import settings

# Two threads of torch beside another busy process are far slower than one; it reads this when it is
# first imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# The user's answers are not for the tests, nor the tests' for the user.
os.environ["PHYSIC_CACHE"] = "off"

# Nor are its settings of plugins, tracebacks and configuration.
for name in [
    n for n in os.environ if n in ("PHYSIC_PLUGINS", "PHYSIC_DEBUG") or n.startswith("PHYSIC__")
]:
    del os.environ[name]

# Modules and collected tests stay alive: with 700, the look for garbage is up to 8 % of the time.
gc.set_threshold(10_000)

# A shell starts background jobs with Ctrl-C ignored, and tests press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples every time, and no clock: a loaded machine must not fail a test.
settings.register_profile("physic", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("physic")


def pytest_collection_modifyitems(items):
    """Files with slow tests come first: whatever two processes start last has to be short."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(autouse=True)
def _no_network(monkeypatch):
    """Fail a test that connects to another machine, or looks up its name, in this process."""

    def refuse_others(host):
        if not (
            host in (None, "", b"", "localhost", b"localhost", "::", "::1", "0.0.0.0")
            or str(host)[:4] == "127."
        ):
            pytest.fail(f"the test uses the network: {host!r}")

    def connect(own, address, original):
        if own.family in (socket.AF_INET, socket.AF_INET6):
            refuse_others(address[0])
        return original(own, address)

    def look_up(host, *arguments, original, **options):
        refuse_others(host)
        return original(host, *arguments, **options)

    for name in ("connect", "connect_ex"):
        monkeypatch.setattr(
            socket.socket, name, partialmethod(connect, original=getattr(socket.socket, name))
        )
    for name in ("getaddrinfo", "gethostbyname"):
        monkeypatch.setattr(socket, name, partial(look_up, original=getattr(socket, name)))


@pytest.fixture(scope="module")
def few_steps():
    """Two steps of the optimiser in each run of a pipeline, for tests of what is around the
    engine.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PHYSIC__ENGINE__JOINT__OPTIMISER__STEPS", "2")
        yield


@pytest.fixture(scope="session")
def saved_pair(tmp_path_factory):
    """The folder of a result of a mock world with two people who sit side by side."""
    from physic_core import load_config, reconstruct
    from physic_testing.worlds import load_world

    world = load_world("sit_side_by_side", (160, 120))
    overrides = ["run.cache=false", "engine.joint.optimiser.steps=3"]  # enough for the files
    folder = tmp_path_factory.mktemp("saved") / "out"
    reconstruct(world.image, load_config(preset="mock", overrides=overrides)).save(
        str(folder), "pictures"
    )
    return folder


@pytest.fixture(scope="session")
def physic():
    """A function that runs the command ``physic`` with these arguments in this process."""

    def run(*arguments):
        from physic_core.cli import main

        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return run


@pytest.fixture(scope="session")
def python():
    """A function that runs code with arguments in a process of its own, and returns what it
    printed; the process has to end with ``ends``, and gets further variables of the environment.
    """

    def run(code, *arguments, ends=0, **variables):
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=300,
            env=os.environ | variables,
        )
        assert done.returncode == ends, done.stdout + done.stderr
        return done

    return run


@pytest.fixture
def repository():
    return Path(__file__).parent


@pytest.fixture(scope="session")
def module_at():
    """A function that imports a file of the repository, such as "tools/sbom.py", under a name of
    its own.
    """

    @cache
    def load(path):
        name = f"file_{path.removesuffix('.py').replace('/', '_').replace('-', '_')}"
        spec = spec_from_file_location(name, Path(__file__).parent / path)
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="session")
def make():
    """Make a room with mannequins: ``make(width, height, people)``."""
    from tests.rooms import make_reconstruction

    return make_reconstruction


@pytest.fixture
def reconstruction(make):
    """A room with two mannequins."""
    return make()


@pytest.fixture(scope="session")
def chromium(module_at):
    """A headless browser, ``tests/chromium.py``, for the tests of pages."""
    driver = module_at("tests/chromium.py")
    binary = driver.find_chromium()
    if os.name != "posix" or binary is None:
        pytest.skip("needs Chromium: apt install chromium")
    browser = driver.Chromium(binary)
    try:
        browser.call("Browser.getVersion")
    except (RuntimeError, OSError) as error:  # such as a link to a package that is not there
        browser.close()
        pytest.skip(f"{binary} does not start: {error}")
    yield browser
    browser.close()


class Site:
    """A folder of installed distributions, written as pip would leave them."""

    def __init__(self, folder):
        self.folder = folder

    def install(
        self,
        distribution,
        source,
        version="1.0",
        entry="",
        group="physic.plugins",
    ):
        """Add a distribution with one module and one group of entry points, or all if ``entry``
        begins with one.

        Return the module's name.
        """
        module = distribution.replace("-", "_")
        (self.folder / f"{module}.py").write_text(source)
        info = self.folder / f"{module}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n"
        )
        entry = entry or f"{distribution.split('-')[-1]} = {module}"
        (info / "entry_points.txt").write_text(
            entry if entry.startswith("[") else f"[{group}]\n{entry}\n"
        )
        return module

    def list_weights(self, distribution, manifest):
        """Add a distribution that lists weights; return the file of the list."""
        folder = self.folder / f"{distribution.replace('-', '_')}_weights"
        folder.mkdir()
        (folder / "sets.toml").write_text(manifest)
        self.install(distribution, "", entry=f"sets = {folder.name}", group="physic.weights")
        return folder / "sets.toml"

    def put(
        self,
        kinds,
        name="own",
        distribution="physic-mine",
        version="0.2",
    ):
        """Add a distribution that offers classes of a test, by interface."""
        lines = []
        for interface, kind in kinds.items():
            kind.written_for = 1
            lines.append(
                f"[physic.{interface}]\n{name} = {distribution.replace('-', '_')}:{interface}\n"
            )
        module = self.install(distribution, "", version, "".join(lines))
        sys.modules[module] = made = ModuleType(module)
        made.__file__ = str(self.folder / f"{module}.py")
        made.__dict__.update(kinds)

    def offer(self, distribution, interface, name, version="1.0", api=1):
        """Add a distribution that offers one backend, of its own module's class ``B``."""
        module = distribution.replace("-", "_")
        source = (
            "from physic_core.interfaces import INTERFACES\n"
            f"class B(INTERFACES[{interface!r}]):\n"
            f"    written_for = {api}\n"
            "    def infer(self, *arguments): raise NotImplementedError\n"
        )
        return self.install(
            distribution, source, version, f"{name} = {module}:B", f"physic.{interface}"
        )


@pytest.fixture
def site(tmp_path, monkeypatch):
    """An empty ``Site`` that this Python can import from; its modules are forgotten afterwards."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield Site(folder)
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(folder)):
            del sys.modules[name]
