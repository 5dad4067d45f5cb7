"""The conformance kit: selects the checks of an interface and runs them, from Python or pytest."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import is_debugging
from physic_core.interfaces import INTERFACES, Backend
from physic_testing.conformance import (
    body_estimator,
    class_checks,
    contact_prior,
    depths,
    hand_estimator,
    inpainter,
    keypoint_detector,
    lifecycle,
    manners,
    output_checks,
    person_observer,
    segmenter,
)
from physic_testing.conformance.accuracy import check_is_exact
from physic_testing.conformance.backend_under_test import BackendUnderTest, find_backend
from physic_testing.conformance.cases import SIZE
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.output_checks import COLOUR_CHECKS
from physic_testing.conformance.readings import check_group
from physic_testing.conformance.run import CheckRun, require_check_names

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import OptionsFor
    from physic_testing.conformance.readings import Group, Table
    from physic_testing.conformance.report import Report

TABLES: dict[str, tuple[Table, tuple[Check, ...]]] = {
    "segmenter": (segmenter.TABLE, segmenter.CHECKS + COLOUR_CHECKS),
    "inpainter": (inpainter.TABLE, inpainter.CHECKS),
    "metric_depth": (depths.DEPTH, depths.DEPTH_CHECKS + COLOUR_CHECKS),
    "relative_pointmap": (depths.POINTS, depths.POINTS_CHECKS + COLOUR_CHECKS),
    "keypoint_detector": (keypoint_detector.TABLE, keypoint_detector.CHECKS + COLOUR_CHECKS),
    "body_estimator": (body_estimator.TABLE, body_estimator.CHECKS),
    "hand_estimator": (hand_estimator.TABLE, hand_estimator.CHECKS),
    "person_observer": (person_observer.TABLE, person_observer.CHECKS),
    "contact_prior": (contact_prior.TABLE, contact_prior.CHECKS),
}
"""Interface -> how outputs are compared with the truth, and further checks; others have only the
general checks.
"""

_EXACT = Check(
    check_is_exact,
    "physic_testing.conformance.CAPABILITIES",
    unless=BLIND,
    only_with=frozenset({"exact"}),
)


def checks_for(interface: str) -> tuple[Check, ...]:
    """Return all checks of an interface, in order of execution."""
    return (
        class_checks.CHECKS
        + lifecycle.CHECKS_BEFORE_INFER
        + output_checks.CHECKS
        + accuracy_checks(interface)
        + lifecycle.CHECKS_AFTER_INFER
        + manners.CHECKS
    )


def accuracy_checks(interface: str) -> tuple[Check, ...]:
    """Return the checks of an interface that compare outputs with the ground truth."""
    if interface not in TABLES:
        return ()
    table, further = TABLES[interface]
    return (*further, *(_check_of(table, group) for group in table.groups), _EXACT)


def _check_of(table: Table, group: Group) -> Check:
    """Return the check of a group."""

    def function(subject: BackendUnderTest) -> None:
        check_group(subject, table, group)

    function.__name__ = f"check_{group.check}"
    function.__doc__ = f"{group.what}."
    return Check(function, table.read, after=(*table.after, *group.after))


def check_backend(
    backend: str | type[Backend] | Backend,
    interface: str | None = None,
    *,
    options: OptionsFor | None = None,
    capabilities: Collection[str] | None = None,
    exact_limits: Mapping[str, float] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    device: str = "cpu",
    size: tuple[int, int] = SIZE,
    progress: Callable[[str, int, int], None] | None = None,
) -> Report:
    """Run the conformance checks of a backend on photos of worlds and return the report.

    Args:
        backend: a name ("my-depth", "distribution:my-depth", "package.module:MyDepth"), a class, or
            an instance.
        interface: name of the interface; required if several interfaces have a backend of this
            name.
        options: options of the backend, or a function that returns the options for a world.
        capabilities: entries of :data:`physic_testing.conformance.CAPABILITIES`, which select
            checks; by default the class attribute ``capabilities``.
        exact_limits: name of an error -> its limit in place of that of the capability "exact", such
            as {"IoU": 0.98}: what the backend's own resampling needs.
        expected_failures: name of a check -> why it is expected to fail; if it passes, it counts as
            a failure.
        device: device on which the backend is loaded.
        size: width and height of the standard photos, px.
        progress: called before each check with its name, the number of checks before it, and that
            of all.

    Raises:
        BackendError: the backend does not exist.
        PhysicError: an expected failure or a capability does not exist.
    """
    settings = {
        "options": options,
        "capabilities": capabilities,
        "exact_limits": exact_limits,
        "device": device,
        "size": size,
    }
    return start_checks(find_backend(backend, interface, **settings), expected_failures).report(
        progress
    )


def start_checks(
    subject: BackendUnderTest, expected_failures: Mapping[str, str] | None = None
) -> CheckRun:
    """Create the run of all checks of a backend; no check runs yet."""
    return CheckRun(subject, checks_for(subject.interface), expected_failures)


def parametrize_with_checks(
    interface: str,
    backend: str | type[Backend],
    *,
    expected_failures: Mapping[str, str] | None = None,
    **settings: Any,
) -> Callable[[Any], Any]:
    """Return a pytest decorator that runs a test once for each check of a backend.

    Use::

        @parametrize_with_checks("metric_depth", "my-depth")
        def test_conformance(check):
            check()

    Nothing is imported or loaded before the first check runs.

    Args:
        interface: name of the interface, such as "metric_depth".
        backend: a name or a class, as for :func:`check_backend`.
        expected_failures: name of a check -> why it is expected to fail; the test fails if the
            check passes.
        settings: options, capabilities, device and size, as for :func:`check_backend`.

    Raises:
        PhysicError: an expected failure is not the name of a check.
    """
    import pytest

    expected = dict(expected_failures or {})
    checks = (
        {check.name: check for check in checks_for(interface)} if interface in INTERFACES else {}
    )
    require_check_names(expected, checks)
    shared = _SharedRun(lambda: start_checks(find_backend(backend, interface, **settings)))
    params = [
        pytest.param(
            BoundCheck(shared, name),
            id=name,
            marks=[pytest.mark.xfail(reason=expected[name], strict=True)]
            if name in expected
            else [],
        )
        for name in checks
    ]
    params.append(pytest.param(shared.require_backend_call, id="backend_was_run"))
    return pytest.mark.parametrize("check", params)


class BoundCheck:
    """One check of one backend, callable as a test."""

    def __init__(self, shared: _SharedRun, name: str) -> None:
        self._shared = shared
        self._name = name

    def __repr__(self) -> str:
        return self._name

    def __call__(self) -> None:
        """Run the check as a pytest test: fail, skip or return."""
        import pytest

        result = self._shared.run().result(self._name)
        if result.outcome == "failed" and result.error is not None and is_debugging():
            raise pytest.fail.Exception(result.message) from result.error
        if result.outcome == "failed":
            pytest.fail(result.message, pytrace=False)
        if result.outcome == "skipped":
            pytest.skip(result.reason)
        if result.outcome == "warned":
            warnings.warn(result.message, stacklevel=2)


class _SharedRun:
    """Run of the checks that all tests of one decorator share."""

    def __init__(self, begin: Callable[[], CheckRun]) -> None:
        self._begin = begin
        self._run: CheckRun | None = None

    def run(self) -> CheckRun:
        """Return the run; create it in the first call."""
        if self._run is None:
            self._run = self._begin()
        return self._run

    def require_backend_call(self) -> None:
        """Fail the test if the backend was never called."""
        import pytest

        reason = self.run().not_run_reason
        self.run().subject.close()
        if reason:
            pytest.fail(
                f"expected: a backend that can be called\ngot:      {reason}", pytrace=False
            )
