"""The camera solvers of this package pass the conformance kit."""

from physic_testing import parametrize_with_checks


@parametrize_with_checks("camera_solver", "people")
def test_people(check):
    check()
