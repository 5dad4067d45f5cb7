"""Both solvers pass the kit where their networks answer what perfect ones would."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from physic_cameras.depth_anything_3 import DepthAnything3Cameras
from physic_cameras.lightglue import LightGlueCameras
from physic_core.adapters.devices import check_device
from physic_testing import check_backend

from .stand_ins import TrueMatcher, TruePoses


class TellingLightGlue(LightGlueCameras):
    def missing(self) -> tuple[str, ...]:
        return ()

    def load(self, device: str = "cpu") -> None:
        check_device(device)
        self._matcher = self._matcher or TrueMatcher()


class TellingDepthAnything3(DepthAnything3Cameras):
    def missing(self) -> tuple[str, ...]:
        return ()

    def load(self, device: str = "cpu") -> None:
        check_device(device)
        self._network = self._network or TruePoses([])

    def infer(self, photos: Any) -> Any:
        if self._network is not None:
            self._network = TruePoses([np.asarray(view.image) for view in photos if len(view.people)])
        return super().infer(photos)


@pytest.mark.parametrize("kind", [TellingLightGlue, TellingDepthAnything3])
def test_a_solver_with_a_perfect_network_holds_its_contract(kind: Any) -> None:
    report = check_backend(kind)
    print(report.text)
    report.raise_if_failed()
