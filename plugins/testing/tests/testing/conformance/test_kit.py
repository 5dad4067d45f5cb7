from __future__ import annotations

from pathlib import Path

import pytest
from faults import fields
from pydantic import Field
from stand_ins import SIZE, RightDepth, stand_in

from physic_core.errors import BackendError, ConfigError
from physic_testing import check_backend
from physic_testing.conformance import checks_for
from physic_testing.conformance.backend_under_test import find_backend

CENTIMETRES = stand_in("MockMetricDepth", fields(depth=lambda z: 100 * z))
RightSegmenter = stand_in("MockSegmenter")
NO_WEIGHTS = "my-depth needs weights.onnx: fetch it from https://example.org and set options.path"


class NotReady(RightDepth):
    def load(self, device="cpu"):
        raise BackendError(NO_WEIGHTS)


class Pointed(RightSegmenter):
    def infer(self, image):
        raise ConfigError("give options.boxes")


class PointedAtWorlds(RightSegmenter):
    class Options(RightSegmenter.Options):
        people: int = Field(0, description="How many people there are.")

    @staticmethod
    def conformance_options(world):
        return {"people": len(world.masks)}

    def infer(self, image):
        if not self.options.people:
            raise ConfigError("give options.people")
        return super().infer(image)


class Stochastic(RightDepth):
    capabilities = ("stochastic",)


class Gpu(RightDepth):
    capabilities = ("needs_cuda",)


def outcome(report, check):
    return next(r for r in report.results if r.check == check)


@pytest.fixture(scope="module")
def failed():
    return check_backend(CENTIMETRES, size=SIZE)


# ---- which backend
# --------------------------------------------------------------------------------------------------


def test_a_name_a_target_a_class_and_an_instance_are_the_same_backend(site):
    site.put({"metric_depth": RightDepth}, "right")
    for backend, interface in (
        ("right", None),
        ("right", "metric_depth"),
        ("stand_ins:RightDepth", "metric_depth"),
        (RightDepth, None),
        (RightDepth(), None),
    ):
        subject = find_backend(backend, interface, size=SIZE)
        assert (subject.kind, subject.interface) == (RightDepth, "metric_depth")


def test_a_name_of_several_interfaces_needs_the_interface(site):
    site.put({"metric_depth": RightDepth, "segmenter": RightSegmenter}, "right")
    with pytest.raises(BackendError, match="metric_depth, segmenter"):
        check_backend("right")


# ---- what comes of it
# ------------------------------------------------------------------------------------------------


def test_a_failure_states_expected_and_found_value_unit_and_reference(failed):
    (failure,) = failed.failures
    assert failure.message.startswith("depth_is_in_metres\n")
    for words in (
        failure.expected,
        failure.got,
        "Is it centimeters",
        "physic_core.interfaces.MetricDepth",
    ):
        assert words in failure.message
    assert failure.expected == "meters"
    assert "of the logarithm too large" in failure.got


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        (NotReady, f"not ready: {NO_WEIGHTS}"),
        (Pointed, "not ready: give options.boxes"),
        (Gpu, "needs a GPU: pass device='cuda'"),
    ],
)
def test_a_backend_that_was_never_run_does_not_pass_and_names_what_it_needs(kind, reason):
    report = check_backend(kind, size=SIZE)
    assert not report.ok
    assert (report.failures, report.not_run_reason) == ((), reason)
    assert report.text.endswith(f"\nBACKEND NEVER RUN: {reason}")
    with pytest.raises(AssertionError, match="BACKEND NEVER RUN"):
        report.raise_if_failed()


def test_a_backend_may_bring_the_options_that_it_needs():
    report = check_backend(PointedAtWorlds, size=SIZE)
    assert report.ok, report.text


# ---- capabilities
# --------------------------------------------------------------------------------------------------


def test_capabilities_choose_checks():
    report = check_backend(Stochastic, size=SIZE)
    assert outcome(report, "output_depends_on_the_photo_alone").reason.count("stochastic")
    assert report.ok
    again = check_backend(Stochastic, size=SIZE, capabilities=())
    assert outcome(again, "output_depends_on_the_photo_alone").outcome == "passed"


# ---- pytest
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pytest_gets_one_test_a_check_and_one_that_something_ran(pytester):
    pytester.makepyfile(
        test_conformance=f"""
        import sys
        sys.path.append({str(Path(__file__).parent)!r})
        from stand_ins import SIZE, RightDepth
        from test_kit import CENTIMETRES, NotReady
        from physic_testing import parametrize_with_checks

        def checks_of(kind):
            @parametrize_with_checks("metric_depth", kind, size=SIZE)
            def run(check):
                check()

            return run

        test_centimetres = checks_of(CENTIMETRES)
        test_not_ready = checks_of(NotReady)
        test_right = checks_of(RightDepth)
        """
    )
    done = pytester.runpytest_subprocess("-p", "no:cacheprovider", "-p", "no:randomly", "-rf")
    total = len(checks_for("metric_depth")) + 1
    counts = done.parseoutcomes()
    assert counts["failed"] == 2
    assert sum(counts[word] for word in ("passed", "failed", "skipped")) == 3 * total
    done.stdout.fnmatch_lines(
        [
            "FAILED test_conformance.py::test_centimetres[[]depth_is_in_metres]*",
            "FAILED test_conformance.py::test_not_ready[[]backend_was_run]*",
        ]
    )
