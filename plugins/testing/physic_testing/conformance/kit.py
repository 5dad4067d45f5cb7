"""The conformance kit: selects the checks of an interface and runs them, from Python or pytest."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import is_debugging
from physic_core.interfaces import INTERFACES, Backend
from physic_testing.conformance import (
    class_checks,
    lifecycle,
    output_checks,
    side_effects,
)
from physic_testing.conformance.accuracy import check_is_exact
from physic_testing.conformance.backend_under_test import BackendUnderTest, find_backend
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.known_mistakes import check_of
from physic_testing.conformance.run import CheckRun
from physic_testing.conformance.tables import TABLES

if TYPE_CHECKING:
    from physic_testing.conformance.report import Report

_EXACT = Check(
    check_is_exact,
    unless=BLIND,
    only_with=frozenset({"exact"}),
    read="physic_testing.conformance.CAPABILITIES",
)


def checks_for(interface: str) -> tuple[Check, ...]:
    """Return all checks of an interface, in order of execution."""
    return (
        *class_checks.CHECKS,
        *lifecycle.CHECKS_BEFORE_INFER,
        *output_checks.CHECKS,
        *accuracy_checks(interface),
        *lifecycle.CHECKS_AFTER_INFER,
        *side_effects.CHECKS,
    )


def accuracy_checks(interface: str) -> tuple[Check, ...]:
    """Return the checks of an interface that compare outputs with the ground truth."""
    table = TABLES.get(interface)
    if table is None:
        return ()
    return (*table.checks, *(check_of(table, group) for group in table.groups), _EXACT)


def check_backend(
    backend: str | type[Backend] | Backend,
    interface: str | None = None,
    *,
    progress: Callable[[str, int, int], None] | None = None,
    **settings: Any,
) -> Report:
    """Run the conformance checks of a backend on photos of worlds and return the report.

    Args:
        backend: a name ("my-depth", "distribution:my-depth", "package.module:MyDepth"), a class, or
            an instance.
        interface: name of the interface; required if several interfaces have a backend of this
            name.
        progress: called before each check with its name, the number of checks before it, and that
            of all.
        settings: ``options`` of the backend, or a function that returns the options for a world;
            ``capabilities``, entries of :data:`physic_testing.conformance.CAPABILITIES`, which
            select checks, by default the class attribute of this name; ``device`` on which the
            backend is loaded; ``size``, width and height of the standard photos, px.

    Raises:
        BackendError: the backend does not exist.
        PhysicError: a capability does not exist.
    """
    return start_checks(find_backend(backend, interface, **settings)).report(progress)


def start_checks(subject: BackendUnderTest) -> CheckRun:
    """Create the run of all checks of a backend; no check runs yet."""
    subject.table = TABLES.get(subject.interface)
    return CheckRun(subject, checks_for(subject.interface))


def parametrize_with_checks(
    interface: str,
    backend: str | type[Backend],
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
        settings: as for :func:`check_backend`.
    """
    import pytest

    @lru_cache(maxsize=1)
    def shared_run() -> CheckRun:
        return start_checks(find_backend(backend, interface, **settings))

    names = [check.name for check in checks_for(interface)] if interface in INTERFACES else []
    each = [pytest.param(partial(_report_to_pytest, shared_run, name), id=name) for name in names]
    last = pytest.param(lambda: _require_backend_call(shared_run()), id="backend_was_run")
    return pytest.mark.parametrize("check", [*each, last])


def _report_to_pytest(shared_run: Callable[[], CheckRun], name: str) -> None:
    """Fail, skip or warn in a pytest test as a check did."""
    import pytest

    result = shared_run().result(name)
    if result.outcome == "failed":
        if result.error is not None and is_debugging():
            raise pytest.fail.Exception(result.message) from result.error
        pytest.fail(result.message, pytrace=False)
    if result.outcome == "skipped":
        pytest.skip(result.reason)
    if result.outcome == "warned":
        warnings.warn(result.message, stacklevel=2)


def _require_backend_call(run: CheckRun) -> None:
    """Close the backend, and fail the test if it was never called."""
    import pytest

    reason = run.not_run_reason
    run.finish()
    if reason:
        pytest.fail(f"expected: a backend that can be called\ngot:      {reason}", pytrace=False)
