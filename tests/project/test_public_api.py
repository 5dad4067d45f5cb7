from __future__ import annotations

import pytest

import physic_core
from physic_core import errors

pytestmark = pytest.mark.quick


def test_public_names_are_sorted():
    assert list(physic_core.__all__) == sorted(physic_core.__all__)


@pytest.mark.parametrize("name", physic_core.__all__)
def test_a_public_name_can_be_imported_from_the_package(name):
    assert getattr(physic_core, name) is not None
    assert name in dir(physic_core)


def test_every_error_is_a_physic_error():
    assert all(issubclass(getattr(errors, name), errors.PhysicError) for name in errors.__all__)
