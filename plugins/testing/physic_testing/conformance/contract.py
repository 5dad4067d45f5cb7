"""Validation of a result against its interface: types, shapes, dtypes and value ranges."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.interfaces import INTERFACES, contract_violations
from physic_core.types import People
from physic_testing.conformance.requests import build_request

if TYPE_CHECKING:
    from physic_core.interfaces import Backend
    from physic_testing.conformance.cases import Case


def case_violations(interface: str, answer: Any, case: Case) -> list[str]:
    """List the contract violations of a result: wrong types, shapes, dtypes and value ranges."""
    return contract_violations(INTERFACES[interface], answer, build_request(interface, case))


def violations(
    interface: type[Backend],
    result: object,
    *,
    height: int = 1,
    width: int = 1,
    people: int = 0,
    **more: Any,
) -> list[str]:
    """List the contract violations of a result that a unit test has built, one sentence each; no
    backend is called.

    Args:
        interface: interface class, such as ``MetricDepth``.
        result: the result of ``infer``.
        height: height of the input image, px.
        width: width of the input image, px.
        people: number of input people.
        more: keyword-only fields of the interface's request.
    """
    image = np.zeros((height, width, 3), np.uint8)
    masks = np.zeros((people, height, width), bool)
    inputs = {"image": image, "people": People(masks, np.zeros((people, 4)), np.zeros(people))}
    request: dict[str, Any] = {
        field.name: inputs.get(field.name)
        for field in fields(interface.Request)
        if not field.kw_only
    }
    return contract_violations(interface, result, interface.Request(**request, **more))
