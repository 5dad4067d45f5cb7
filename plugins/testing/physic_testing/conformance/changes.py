"""Changes to a photo, or to what is given with it, and the resulting changes in the output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types import Hints
from physic_testing.conformance.cases import FIRST_PHOTO
from physic_testing.conformance.check import BLIND, SAME, Check
from physic_testing.conformance.expect import expect_same
from physic_testing.conformance.requests import read_only_view

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case


@dataclass(frozen=True)
class Change:
    """A change to a request, and the resulting change in the output.

    Attributes:
        check: name of the check.
        what: what the contract requires of the output.
        request: request and photo -> changed request.
        output: output for the unchanged request, and photo -> that for the changed one; without it,
            any valid output is right.
        hint: likely cause of another output.
        photo: name of the photo.
        may_refuse: whether a PhysicError is right, too.
    """

    check: str
    what: str
    request: Callable[[Any, Case], Any]
    output: Callable[[Any, Case], Any] | None = None
    hint: str = ""
    photo: str = "one person"
    may_refuse: bool = False

    def as_check(self, **conditions: Any) -> Check:
        """Return the check of this change.

        Args:
            conditions: of :class:`Check`.
        """

        def function(subject: BackendUnderTest) -> None:
            case, request = subject.valid_request(self.photo)
            changed = self.request(request, case)
            answer = subject.call(self.what, case, changed, self.hint, may_refuse=self.may_refuse)
            if answer is not None and self.output and not SAME & subject.declared:
                wanted = self.output(subject.result(self.photo), case)
                expect_same(self.what, wanted, answer, self.hint)

        function.__name__ = f"check_{self.check}"
        function.__doc__ = f"{self.what}."
        return Check(function, **conditions)


def without(hint: str) -> Callable[[Any, Case], Any]:
    """Return the change of a request that takes a hint away."""
    return lambda request, _: replace(request, hints=replace(request.hints, **{hint: None}))


def unchanged(answer: Any, case: Case) -> Any:
    """Return the output as it is."""
    return answer


WITHOUT_HINTS = Change(
    "works_without_hints",
    "valid output for Hints(), or a PhysicError that names the missing hint",
    lambda request, _: replace(request, hints=Hints()),
    may_refuse=True,
).as_check(read="physic_core.types.Hints")
"""Check of interfaces whose ``infer`` receives hints."""

ARRAY_VIEWS = Change(
    "accepts_array_views",
    "the same output for read-only arrays with negative strides, as of photos rotated by EXIF data",
    lambda request, _: read_only_view(request),
    unchanged,
    "Call np.ascontiguousarray(array) before torch.from_numpy; copy before writing.",
    FIRST_PHOTO,
).as_check(after=("output_depends_on_the_photo_alone", "does_not_modify_its_input"))

GRAY = Change(
    "ignores_the_image",
    "the same output for an image all gray, as the capability 'ignores_image' declares",
    lambda request, _: replace(request, image=np.full_like(request.image, 128)),
    unchanged,
    "Remove 'ignores_image' from `capabilities`: the checks of bias then run.",
).as_check(only_with=BLIND, read="physic_testing.conformance.CAPABILITIES")
