from __future__ import annotations

import json

import pytest
from pydantic import Field
from right_backends import SIZE, RightMetricDepth, RightOptions, RightSegmenter
from wrong_backends import WRONG

from physic_core.errors import BackendError, ConfigError
from physic_testing import check_backend
from physic_testing.conformance import checks_for
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.compare import compare

CENTIMETRES = next(
    m.kind for m in WRONG if m.mistake == "centimetres" and m.kind.interface == "metric_depth"
)
NO_WEIGHTS = "my-depth needs weights.onnx: fetch it from https://example.org and set options.path"


class NotReady(RightMetricDepth):
    def load(self, device="cpu"):
        raise BackendError(NO_WEIGHTS)


class Pointed(RightSegmenter):
    def infer(self, image):
        raise ConfigError("give options.boxes")


class PointedAtWorlds(RightSegmenter):
    class Options(RightOptions):
        people: int = Field(0, description="How many people there are.")

    @staticmethod
    def conformance_options(world):
        return {"people": len(world.masks)}

    def infer(self, image):
        if not self.options.people:
            raise ConfigError("give options.people")
        return super().infer(image)


class Stochastic(RightMetricDepth):
    capabilities = ("stochastic",)


class Gpu(RightMetricDepth):
    capabilities = ("needs_cuda",)


def outcome(report, check):
    return next(r for r in report.results if r.check == check)


# ---- which backend
# --------------------------------------------------------------------------------------------------


def test_a_name_a_target_a_class_and_an_instance_are_the_same_backend(site):
    site.put({"metric_depth": RightMetricDepth}, "right")
    for backend, interface in (
        ("right", None),
        ("right", "metric_depth"),
        ("right_backends:RightMetricDepth", "metric_depth"),
        (RightMetricDepth, None),
        (RightMetricDepth(), None),
    ):
        subject = find_backend(backend, interface, size=SIZE)
        assert (subject.kind, subject.interface) == (RightMetricDepth, "metric_depth")
    assert check_backend("right", size=SIZE).ok


def test_a_name_of_several_interfaces_needs_the_interface(site):
    site.put({"metric_depth": RightMetricDepth, "segmenter": RightSegmenter}, "right")
    with pytest.raises(BackendError, match="metric_depth, segmenter"):
        check_backend("right")
    with pytest.raises(BackendError, match=r"^no interface named 'depth'; valid are: segmenter, "):
        check_backend("right", "depth")


# ---- what comes of it
# ------------------------------------------------------------------------------------------------


def test_a_failure_states_expected_and_found_value_unit_and_reference():
    (failure,) = check_backend(CENTIMETRES, size=SIZE).failures
    assert failure.message.startswith("depth_is_in_metres\n")
    for words in (
        failure.expected,
        failure.got,
        "Is it centimetres",
        "physic_core.types.DepthMap",
    ):
        assert words in failure.message
    assert failure.expected == "metres"
    assert "of the logarithm too large" in failure.got


def test_the_summary_counts_passed_failed_and_skipped_checks():
    report = check_backend(CENTIMETRES, size=SIZE)
    total = len(checks_for("metric_depth"))
    assert f"{total} checks: {total - 6} passed, 1 failed, 5 skipped" in report.summary
    assert sum(report.counts.values()) == total


def test_the_last_line_says_whether_the_backend_passed():
    assert check_backend(CENTIMETRES, size=SIZE).text.endswith("\nfailed: depth_is_in_metres")
    passed = check_backend(RightMetricDepth, size=SIZE)
    assert passed.text.rpartition("\n")[2] == f"passed: {passed.counts['passed']} checks"


def test_an_expected_failure_is_no_failure():
    report = check_backend(
        CENTIMETRES, size=SIZE, expected_failures={"depth_is_in_metres": "known"}
    )
    assert report.ok
    assert outcome(report, "depth_is_in_metres").outcome == "xfailed"
    assert "1 failed as expected" in report.summary


def test_an_expected_failure_that_passes_is_a_failure():
    report = check_backend(
        RightMetricDepth, size=SIZE, expected_failures={"depth_is_in_metres": "known"}
    )
    assert not report.ok
    assert "it passes" in report.failures[0].message


def test_a_backend_that_cannot_be_loaded_does_not_pass():
    report = check_backend(NotReady, size=SIZE)
    assert not report.ok
    assert report.failures == ()
    assert report.not_run_reason == f"not ready: {NO_WEIGHTS}"
    assert report.text.endswith(f"\nBACKEND NEVER RUN: not ready: {NO_WEIGHTS}")
    with pytest.raises(AssertionError, match="BACKEND NEVER RUN"):
        report.raise_if_failed()


def test_a_backend_that_needs_options_names_them():
    report = check_backend(Pointed, size=SIZE)
    assert report.failures == ()
    assert report.not_run_reason == "not ready: give options.boxes"


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


def test_a_backend_that_needs_a_gpu_is_not_called_without_one():
    report = check_backend(Gpu, size=SIZE)
    assert report.not_run_reason == "needs a GPU: pass device='cuda'"


# ---- accuracy
# --------------------------------------------------------------------------------------------------


def test_backends_are_compared_in_one_table():
    worlds = ("stand_indoors", "group")
    found = compare(
        "metric_depth", [RightMetricDepth, CENTIMETRES, NotReady], worlds=worlds, size=SIZE
    )
    right, hundred, missing = found.rows
    assert right.errors["abs-rel"] == pytest.approx(0, abs=1e-6)
    assert hundred.errors["abs-rel"] == pytest.approx(99, abs=1e-3)
    assert right.errors["delta1"] == 1
    assert (right.completed, missing.completed) == (2, 0)
    head, first, _, third, note, about = found.text.splitlines()
    assert head.split("  ")[0] == "backend"
    assert "*" in first
    assert third.endswith("0 of 2")
    assert note.endswith(f": not ready: {NO_WEIGHTS}")
    assert about.startswith(
        "metric_depth on synthetic worlds of 160 x 120 px: stand_indoors, group; people"
    )
    json.dumps(found.as_dict(), allow_nan=False)


# ---- pytest
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pytest_gets_one_test_a_check_and_one_that_something_ran(pytester):
    pytester.makepyfile(
        test_conformance="""
        import sys
        sys.path.append({folder!r})
        from right_backends import SIZE, RightMetricDepth
        from test_kit import CENTIMETRES, NotReady
        from physic_testing import parametrize_with_checks

        @parametrize_with_checks("metric_depth", CENTIMETRES, size=SIZE)
        def test_centimetres(check):
            check()

        @parametrize_with_checks(
            "metric_depth", CENTIMETRES, size=SIZE, expected_failures={{"depth_is_in_metres": "known"}}
        )
        def test_known_centimetres(check):
            check()

        @parametrize_with_checks("metric_depth", NotReady, size=SIZE)
        def test_not_ready(check):
            check()

        @parametrize_with_checks(
            "metric_depth", RightMetricDepth, size=SIZE, expected_failures={{"depth_is_in_metres": "no"}}
        )
        def test_right(check):
            check()
        """.format(folder=str(__import__("pathlib").Path(__file__).parent))  # noqa: E501
    )
    done = pytester.runpytest_subprocess("-p", "no:cacheprovider", "-p", "no:randomly", "-rf")
    total = len(checks_for("metric_depth")) + 1
    counts = done.parseoutcomes()
    assert (counts["failed"], counts["xfailed"]) == (3, 1)
    assert sum(counts[word] for word in ("passed", "failed", "skipped", "xfailed")) == 4 * total
    done.stdout.fnmatch_lines(
        [
            "FAILED test_conformance.py::test_centimetres[[]depth_is_in_metres]*",
            "FAILED test_conformance.py::test_not_ready[[]backend_was_run]*",
            "FAILED test_conformance.py::test_right[[]depth_is_in_metres]*",
        ]
    )
