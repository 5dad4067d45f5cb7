from physic_testing import parametrize_with_checks


@parametrize_with_checks("inpainter", "pull-push")
def test_conformance(check):
    check()
