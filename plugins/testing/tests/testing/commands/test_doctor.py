"""``physic plugins doctor``: every backend is loaded, whatever the others do."""

from __future__ import annotations

SICK = (
    "import os, time\n"
    "from physic_core.errors import BackendError\n"
    "from physic_core.interfaces import Inpainter\n"
    "class Well(Inpainter):\n"
    "    written_for = 1\n"
    "    def infer(self, image, mask): return image\n"
    "class Lacking(Well):\n"
    "    def load(self, device='cpu'): raise BackendError('no checkpoint at /x: get it from /y')\n"
    "class Failing(Well):\n"
    "    def load(self, device='cpu'): raise ValueError('bad magic number')\n"
    "class Dying(Well):\n"
    "    def load(self, device='cpu'): os._exit(9)\n"
    "class Hanging(Well):\n"
    "    def load(self, device='cpu'): time.sleep(600)\n"
    "class Unclosed(Well):\n"
    "    def close(self): raise RuntimeError('still open')\n"
)
NAMES = ("well", "lacking", "failing", "dying", "unclosed")


def install(site, *names):
    entries = "\n".join(f"{name} = physic_sick:{name.capitalize()}" for name in names)
    site.install("physic-sick", SICK, entry=entries, group="physic.inpainter")


def lines_of_others(done):
    """Lines without that of the mock, which comes with the command."""
    return [line for line in done.stdout.splitlines() if "'mock'" not in line]


def test_the_doctor_looks_at_every_backend_whatever_the_others_do(site, monkeypatch, physic):
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-sick,physic-bad,metricbody-testing")
    install(site, *NAMES)
    site.install("physic-bad", "import no_such_module\n", version="0.3")
    done = physic("plugins", "doctor", "--interface", "inpainter")
    assert done.exit_code == 5
    *findings, total = lines_of_others(done)
    wanted = (
        ("BROKEN", "'dying'", "code 9"),
        ("BROKEN", "'failing'", "ValueError: bad magic number (physic_sick.py:10)"),
        ("missing", "'lacking'", "no checkpoint at /x"),
        ("BROKEN", "'unclosed'", "RuntimeError: still open"),
        ("ok", "'well'"),
        ("BROKEN", "physic-bad 0.3", "no_such_module"),
    )
    for line, (state, *words) in zip(findings, wanted, strict=True):
        assert line.startswith(state)
        assert all(word in line for word in words), line
    assert total == "7 checked: 2 ok, 1 missing, 4 broken"


def test_a_backend_that_hangs_is_broken_after_the_time_limit(site, monkeypatch, physic):
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-sick,metricbody-testing")
    install(site, "hanging")
    done = physic("plugins", "doctor", "--interface", "inpainter", "--timeout", "2")
    assert done.exit_code == 5
    (line, _) = lines_of_others(done)
    assert line.startswith("BROKEN")
    assert "'hanging'" in line
    assert "2 s" in line
