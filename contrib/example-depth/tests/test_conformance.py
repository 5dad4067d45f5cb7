from physic_testing import parametrize_with_checks


@parametrize_with_checks("metric_depth", "stature")
def test_conformance(check):
    check()
