"""What all interfaces share: options, the life of a backend, and how its results are checked."""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from pydantic import BaseModel, ConfigDict

from physic_core.interfaces.checks import check_type, require_image

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

__all__ = ["Backend", "Options", "Request", "Result", "call", "interface_of", "violations"]

Result = TypeVar("Result")


class Options(BaseModel):
    """Base of a backend's settings: unknown keys are refused, every field carries a description."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@dataclass(frozen=True)
class Request(Generic[Result]):
    """What a backend is given. Its fields are the arguments of ``infer``, in their order.

    Keyword-only fields are not passed to ``infer``; they are what ``check`` needs beyond the arguments.

    Attributes:
        image: (H, W, 3) uint8 RGB.
    """

    image: UInt8Array

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The arguments of ``infer``."""
        return tuple(getattr(self, field.name) for field in fields(self) if not field.kw_only)


class Backend(ABC):
    """What every interface shares.

    An interface is a direct subclass that defines ``interface``, ``api``, ``Request``, ``Result``, ``infer`` and
    ``check``. A backend is a subclass of an interface.

    Attributes:
        interface: the interface's name in configs.
        api: version of the interface; the record of a backend states the version that it was written for.
        Request: what the interface is given.
        Result: class of what it returns; ``object`` for an array, which ``check`` then looks at.
        sees: which image it is given first: the photo, or the photo with its people inpainted.
        hints: names of the :class:`physic_core.types.Hints` that the pipeline knows when it calls the interface.
        Options: pydantic model of this backend's settings.
        cacheable: whether the output may be cached. Set it to False if the output depends on anything but the input,
            options, files that options name and ``fingerprint()``, or if computing it is faster than reading it.
    """

    interface: ClassVar[str]
    api: ClassVar[int]
    Request: ClassVar[type[Request[Any]]]
    Result: ClassVar[type]
    sees: ClassVar[str] = "photo"
    hints: ClassVar[tuple[str, ...]] = ()
    Options: ClassVar[type[Options]] = Options
    cacheable: ClassVar[bool] = True

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    def load(self, device: str = "cpu") -> None:  # noqa: B027 -- a backend without weights has nothing to do
        """Read weights into memory on ``device`` ("cpu", "cuda", "cuda:1")."""

    def close(self) -> None:  # noqa: B027
        """Release everything that ``load`` took."""

    def missing(self) -> tuple[str, ...]:
        """What this backend with its options needs but does not find on this machine, one line each with the remedy.

        Cheap and offline, the same at every call, and called before ``load``. A run in which anything is missing stops
        before it begins, and lists what is missing for all backends.
        """
        return ()

    def fingerprint(self) -> str:
        """What else a result depends on, such as the revision of weights in a folder. Called before ``load``.

        A short text, cheap to compute, the same for the same weights wherever they are stored; empty if there is
        nothing else. Cached results are used only while it stays the same. Files that options name are tracked without
        it.
        """
        return ""

    @classmethod
    def check(cls, result: Any, request: Any) -> Iterator[str]:
        """Yield one sentence per violation of the interface: what was expected and what was returned.

        The pipeline raises them, the conformance kit reports them. Values that are not finite are a violation only if
        no person has finite ones: the pipeline goes on with the others.
        """
        raise NotImplementedError


def interface_of(backend: type[Backend]) -> type[Backend]:
    """The interface that a backend class implements: its base that names itself in ``interface``."""
    return next(c for c in reversed(backend.__mro__) if issubclass(c, Backend) and "interface" in vars(c))


def violations(interface: type[Backend], result: object, request: Request[Any]) -> list[str]:
    """How a result violates its interface, one sentence each; empty for a valid result."""
    wrong_type = list(check_type(result, interface.Result))
    if wrong_type:
        return wrong_type
    try:
        return list(interface.check(result, request))
    except Exception as cause:  # fields of types that no check expects
        return [f"{type(result).__name__} cannot be read: {type(cause).__name__}: {cause}"]


def call(backend: Backend, request: Request[Any]) -> object:
    """What ``infer`` returns for a request, not yet checked.

    Raises:
        InputError: the image of the request is no photo; the backend is not called.
    """
    require_image(request.image)
    infer: Any = getattr(backend, "infer")  # noqa: B009 -- each interface has arguments of its own
    result: object = infer(*request.arguments)
    return result
