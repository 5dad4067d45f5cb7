"""The whole kit: which checks each interface has, run from Python or by pytest."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import debugging
from physic_core.interfaces import INTERFACES, Backend
from physic_testing.conformance import (
    answering,
    before_load,
    body_estimator,
    colours,
    contact_prior,
    hand_estimator,
    inpainter,
    keypoint_detector,
    lifecycle,
    metric_depth,
    registration,
    relative_pointmap,
    segmenter,
)
from physic_testing.conformance.cases import SIZE
from physic_testing.conformance.run import Run, require_known
from physic_testing.conformance.subject import Subject, find_subject

if TYPE_CHECKING:
    from physic_core.discovery.registry import Registry
    from physic_testing.conformance.check import Check
    from physic_testing.conformance.report import Report
    from physic_testing.conformance.subject import OptionsFor

__all__ = ["BoundCheck", "check_backend", "checks_for", "parametrize_with_checks", "start"]

_OWN: dict[str, tuple[Check, ...]] = {
    "segmenter": answering.CHECKS_OF_PEOPLE + segmenter.CHECKS + colours.CHECKS,
    "inpainter": inpainter.CHECKS,
    "metric_depth": answering.CHECKS_OF_HINTS + metric_depth.CHECKS + colours.CHECKS,
    "relative_pointmap": relative_pointmap.CHECKS + colours.CHECKS,
    "keypoint_detector": keypoint_detector.CHECKS + colours.CHECKS,
    "body_estimator": body_estimator.CHECKS,
    "hand_estimator": hand_estimator.CHECKS,
    "contact_prior": contact_prior.CHECKS,
}
"""Checks of results against the truth of a world; an interface that is not listed has the general checks only."""


def checks_for(interface: str) -> tuple[Check, ...]:
    """All checks of an interface, in the order in which they make sense."""
    return (
        registration.CHECKS
        + lifecycle.BEFORE
        + before_load.SAYINGS
        + answering.CHECKS
        + _OWN.get(interface, ())
        + lifecycle.AFTER
    )


def check_backend(
    backend: str | type[Backend] | Backend,
    interface: str | None = None,
    *,
    options: OptionsFor | None = None,
    capabilities: Collection[str] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    registry: Registry | None = None,
    device: str = "cpu",
    size: tuple[int, int] = SIZE,
) -> Report:
    """Try a backend on photos of worlds, and say what it does not do that its interface promises.

    Args:
        backend: a name ("my-depth", "distribution:my-depth", "package.module:MyDepth"), a class, or an instance.
        interface: needed for a name that several interfaces have.
        options: the backend's, or a function of the world whose photo is shown.
        capabilities: words of :data:`physic_testing.conformance.CAPABILITIES` that choose checks; None for those
            that the class names in its attribute ``capabilities``.
        expected_failures: name of a check -> why it is known to fail; if it passes, that is a failure too.
        registry: where names are looked up; None for everything installed.
        device: where the backend is loaded.
        size: width and height of the ordinary photos, px.

    Raises:
        BackendError: there is no such backend.
        PhysicError: an expected failure or a capability that does not exist.
    """
    settings = {"options": options, "capabilities": capabilities, "device": device, "size": size}
    return start(find_subject(backend, interface, registry, **settings), expected_failures).report()


def start(subject: Subject, expected_failures: Mapping[str, str] | None = None) -> Run:
    """All checks of a subject, none of them run yet."""
    return Run(subject, checks_for(subject.interface), expected_failures)


def parametrize_with_checks(
    interface: str,
    backend: str | type[Backend],
    *,
    expected_failures: Mapping[str, str] | None = None,
    registry: Registry | None = None,
    **settings: Any,
) -> Callable[[Any], Any]:
    """A pytest decorator: one test for each check of a backend.

    Use::

        @parametrize_with_checks("metric_depth", "my-depth")
        def test_conformance(check):
            check()

    Nothing is imported or loaded before the first check runs.

    Args:
        interface: "metric_depth", ...
        backend: a name or a class, as for :func:`check_backend`.
        expected_failures: name of a check -> why it is known to fail; strict.
        registry: as for :func:`check_backend`.
        settings: options, capabilities, device and size, as for :func:`check_backend`.

    Raises:
        PhysicError: an expected failure names no check.
    """
    import pytest

    expected = dict(expected_failures or {})
    checks = {check.name: check for check in checks_for(interface)} if interface in INTERFACES else {}
    require_known(expected, checks)
    shared = _Shared(lambda: start(find_subject(backend, interface, registry, **settings)))
    params = [
        pytest.param(
            BoundCheck(shared, name),
            id=name,
            marks=[pytest.mark.xfail(reason=expected[name], strict=True)] if name in expected else [],
        )
        for name in checks
    ]
    params.append(pytest.param(shared.require_something, id="something_was_asked"))
    return pytest.mark.parametrize("check", params)


class BoundCheck:
    """One check of one backend, to be called in a test."""

    def __init__(self, shared: _Shared, name: str) -> None:
        self._shared, self._name = shared, name

    def __repr__(self) -> str:
        return self._name

    def __call__(self) -> None:
        """Run the check as a test: fail, skip or return."""
        import pytest

        result = self._shared.run().result(self._name)
        if result.outcome == "failed" and result.error is not None and debugging():
            raise pytest.fail.Exception(result.message) from result.error
        if result.outcome == "failed":
            pytest.fail(result.message, pytrace=False)
        if result.outcome == "skipped":
            pytest.skip(result.reason)


class _Shared:
    """The run that the tests of one decorator share."""

    def __init__(self, begin: Callable[[], Run]) -> None:
        self._begin = begin
        self._run: Run | None = None

    def run(self) -> Run:
        if self._run is None:
            self._run = self._begin()
        return self._run

    def require_something(self) -> None:
        """Fail where every check was skipped."""
        import pytest

        reason = self.run().not_asked
        self.run().subject.close()
        if reason:
            pytest.fail(f"expected: a backend that can be asked\ngot:      {reason}", pytrace=False)
