"""Base classes of all interfaces: backend, request, options and requirements; calls and validation
of results.
"""

from __future__ import annotations

import inspect
from abc import ABC, ABCMeta, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from physic_core.errors import BackendOutputError, ConfigError, InputError
from physic_core.interfaces.checks import check_type, require_image
from physic_core.types import Hints

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

Result = TypeVar("Result")


class StrictModel(BaseModel):
    """Base class of settings: they cannot be changed, and unknown keys are an error."""

    # Without "constants", results would record infinities as None.
    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="constants")

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_bool(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse true and false where no boolean is declared: pydantic takes them for 1 and 0."""
        kind = cls.model_fields[str(info.field_name)].annotation
        if _holds_bool(value) and not {bool, Any, object}.intersection(_annotation_types(kind)):
            raise ValueError(f"should not be true or false (got {str(value).lower()})")
        return value


def _holds_bool(value: Any) -> bool:
    return isinstance(value, bool) or (
        isinstance(value, (list, tuple)) and any(map(_holds_bool, value))
    )


def _annotation_types(kind: Any) -> Iterator[Any]:
    """Yield the types of which an annotation is made, such as float and None of ``tuple[float, ...]
    | None``.
    """
    inner = get_args(kind)
    if inner and get_origin(kind) is not Literal:
        for each in inner:
            yield from _annotation_types(each)
    else:
        yield from map(type, inner) if inner else (kind,)


class Options(StrictModel):
    """Base class of a backend's settings; unknown keys are an error, every field needs a
    description.
    """


@dataclass(frozen=True)
class Request(Generic[Result]):
    """Input of one backend call; its fields are the arguments of ``infer`` in order, first the
    image.

    Keyword-only fields are used by ``check`` alone and are not passed to ``infer``. ``image`` is
    (H, W, 3) uint8 RGB.
    """

    image: UInt8Array

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Return the arguments of ``infer``: the fields that are not keyword-only."""
        return tuple(getattr(self, field.name) for field in fields(self) if not field.kw_only)

    def arguments_read(self, reads: tuple[str, ...] | None) -> tuple[Any, ...]:
        """Return the arguments of ``infer`` for a backend that declares what it reads.

        Args:
            reads: see :attr:`Backend.reads`.

        Returns:
            The arguments. Hints that the backend does not read are None, and using another argument
            that it does not read raises an AttributeError.
        """
        if reads is None:
            return self.arguments
        named = zip(fields(self), self.arguments, strict=False)  # keyword-only fields come last
        return tuple(_limited(field.name, value, reads) for field, value in named)


@dataclass(frozen=True)
class _Unread:
    """Stand-in for an argument that a backend does not read."""

    name: str

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):  # copy and pickle look for such methods
            raise AttributeError(attribute)
        raise AttributeError(
            f"`reads` of this backend lacks '{self.name}', whose '{attribute}' it uses: add the "
            f"name"
        )


def _limited(name: str, value: Any, reads: tuple[str, ...]) -> Any:
    if isinstance(value, Hints):
        return replace(
            value, **{field.name: None for field in fields(value) if field.name not in reads}
        )
    return value if name == "image" or name in reads else _Unread(name)


@dataclass(frozen=True)
class Packages:
    """Packages of the environment.

    Attributes:
        modules: import names.
    """

    modules: tuple[str, ...]


@dataclass(frozen=True)
class Repository:
    """A repository of git whose checkout an option names.

    Attributes:
        option: option with the folder of the checkout.
        name: project name.
        url: for ``git clone``.
        commit: hexadecimal digits of the commit that the backend was tested with; "" if none was.
        folder: value of the option, "" if it is not set.
        local_commit: commit of that folder; "" if it is not a checkout.
        is_here: whether the code is there, or installed in the environment.
    """

    option: str
    name: str
    url: str
    commit: str = ""
    folder: str = ""
    local_commit: str = ""
    is_here: bool = False


@dataclass(frozen=True)
class UserFile:
    """A file or a model that the user gets by hand.

    Attributes:
        option: option with its path; "" if no option is needed.
        name: of the file.
        advice: one line: where to register, which license to accept, what to download.
        account: web address that asks for an account; "" if none does.
        bytes: size, None if unknown.
        is_here: whether it is on this machine.
    """

    option: str
    name: str
    advice: str
    account: str = ""
    bytes: int | None = None
    is_here: bool = False


@dataclass(frozen=True)
class GpuMemory:
    """Memory of a GPU that the backend takes.

    Attributes:
        gigabytes: of it.
        source: who measured it.
    """

    gigabytes: float
    source: str


Requirement = Packages | Repository | UserFile | GpuMemory


class _OptionsAsKeywords(ABCMeta):
    """Constructs backends with options as keyword arguments, whatever their ``__init__``
    accepts.
    """

    def __call__(cls, *arguments: Any, **named: Any) -> Any:
        accepted = inspect.signature(cls.__init__).parameters  # type: ignore[misc]
        settings = {name: named.pop(name) for name in tuple(named) if name not in accepted}
        if settings and (arguments or named):
            raise ConfigError(
                f"{cls.__name__} takes its options as keyword arguments or as one object, not as "
                f"both"
            )
        if settings:
            arguments = (_options(cls, settings),)
        backend = super().__call__(*arguments, **named)
        if not hasattr(backend, "options"):
            raise TypeError(
                f"{cls.__name__}.__init__ leaves out the options: call super().__init__(options)"
            )
        return backend


def _options(kind: Any, settings: dict[str, Any]) -> BaseModel:
    try:
        options: BaseModel = kind.Options(**settings)
    except ValidationError as error:
        names = ", ".join(kind.Options.model_fields) or "none"
        problems = [
            f"no option '{problem['loc'][-1]}'; there are: {names}"
            if problem["type"] == "extra_forbidden"
            else f"{'.'.join(map(str, problem['loc']))}: {problem['msg']} "
            f"(got {problem['input']!r:.80})"
            for problem in error.errors(include_url=False)
        ]
        raise ConfigError(f"{kind.__name__}: {'; '.join(problems)}") from error
    return options


class Backend(ABC, metaclass=_OptionsAsKeywords):
    """Base class of all interfaces.

    ``MyBackend(size=3)`` sets options, and ``MyBackend(MyBackend.Options(size=3))`` is the same.

    An interface is a direct subclass that defines ``interface``, ``api``, ``Request``, ``Result``,
    ``infer`` and ``check``. A backend is a subclass of an interface.

    Attributes:
        interface: the interface's name in configs.
        api: version of the interface.
        written_for: version of the interface that a backend was written for, such as 1. A core with
            another version refuses it. Every backend of a plugin states it.
        Request: class of its requests.
        Result: class of its results; ``object`` for an array, which ``check`` validates.
        sees: image of its first call: "photo", or "inpainted" for the photo with its people
            removed.
        hints: names of the :class:`physic_core.types.Hints` that the pipeline knows when it calls
            the interface.
        reads: names of the arguments of ``infer`` and of the hints that the backend reads, without
            ``image``. It gets no others, and a cached result stays valid while these are equal.
            None if it may read everything.
        Options: pydantic model of this backend's settings.
        cacheable: whether the output may be cached. Set it to False if the output depends on
            anything but the input, options, files that options name and ``fingerprint()``, or if
            computing it is faster than reading it.
        weights_license: license of weights that lie inside the plugin's own package, such as "MIT
            (MI-GAN)". That of other weights stands in their manifest
            (:mod:`physic_core.weights.manifest`).
    """

    interface: ClassVar[str]
    api: ClassVar[int]
    written_for: ClassVar[int]
    Request: ClassVar[type[Any]]
    Result: ClassVar[type]
    sees: ClassVar[str] = "photo"
    hints: ClassVar[tuple[str, ...]] = ()
    reads: ClassVar[tuple[str, ...] | None] = None
    Options: ClassVar[type[Options]] = Options
    cacheable: ClassVar[bool] = True
    weights_license: ClassVar[str] = ""
    infer: Callable[..., Any]  # each interface has arguments of its own

    def __init_subclass__(cls, **named: Any) -> None:
        """Refuse a class with a name in ``reads`` that is neither an argument nor a hint of its
        interface.
        """
        super().__init_subclass__(**named)
        if isinstance(cls.reads, str):
            raise TypeError(
                f'{cls.__name__}.reads is a string: write a tuple, reads = ("{cls.reads}",)'
            )
        if cls.reads is None or not hasattr(cls, "Request"):  # a base class of several interfaces
            return
        known = {field.name for kind in (cls.Request, Hints) for field in fields(kind)}
        if wrong := sorted(set(cls.reads) - known):
            names = ", ".join(sorted(known))
            raise TypeError(
                f"{cls.__name__}.reads: no argument or hint is named {', '.join(wrong)}; there "
                f"are: {names}"
            )

    # keywords become ``options`` before
    def __init__(self, options: BaseModel | None = None, **_: Any) -> None:
        self.options = self.Options() if options is None else options

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Run a loaded backend alone, and check its result.

        Args:
            arguments: those of ``infer``, in their order; of a single photo, the first is its image
                (H, W, 3) uint8 RGB.
            named: the same by name. ``hints`` may be omitted.

        Returns:
            The result of ``infer``.

        Raises:
            InputError: the image is invalid, or an argument is missing or unknown.
            BackendOutputError: the result violates the interface.
        """
        kind = interface_of(type(self))
        try:
            request = kind.Request(*arguments, **named)
        except TypeError as error:
            takes = ", ".join(field.name for field in fields(kind.Request) if not field.kw_only)
            raise InputError(
                f"{kind.interface} is called with {takes}: {str(error).partition('() ')[2]}"
            ) from error
        result = call(self, request)
        if wrong := contract_violations(kind, result, request):
            raise BackendOutputError(
                f"{type(self).__name__} returned an invalid result: {'; '.join(wrong)}"
            )
        return result

    def load(self, device: str = "cpu") -> None:
        """Read weights into memory on ``device`` ("cpu", "cuda", "cuda:1"); do nothing if the
        backend is loaded.
        """

    def close(self) -> None:
        """Release the weights and all other memory that ``load`` allocated."""

    @staticmethod
    def release_memory() -> None:
        """Give freed memory back that a library of this backend keeps for the whole process.

        Called after the last backend of a photo, whether backends are closed or not.
        """

    def missing(self) -> tuple[str, ...]:
        """Return one line for each file or package that this backend needs and does not find, with
        the remedy.

        Cheap and offline, the same at every call, and called before ``load``. If any backend of a
        run misses something, the run stops before its first stage with a list for all backends.
        """
        return ()

    def requirements(self) -> tuple[Requirement, ...]:
        """Return what this backend needs besides the weight sets that its options name, whether it
        is here or not.

        ``physic setup`` makes its steps from it. Cheap and offline.
        """
        return ()

    def fingerprint(self) -> str:
        """Return a short text that identifies the weights, as a part of the cache key; "" if there
        are none.

        Cheap to compute, called before ``load``, and equal for equal weights in different folders.
        Files that options name are tracked without it.
        """
        return ""

    @classmethod
    @abstractmethod
    def check(cls, result: Any, request: Any) -> Iterator[str]:
        """Yield one sentence per violation of the interface: what was expected and what was
        returned.

        Numbers of people that are not finite, or beyond :mod:`physic_core.interfaces.checks`, are a
        violation only if no person has valid ones: the pipeline continues with the others.
        """


def interface_of(backend: type[Backend]) -> type[Backend]:
    """Return the interface that a backend class implements: the base class that defines
    ``interface``.
    """
    return next(
        c for c in reversed(backend.__mro__) if issubclass(c, Backend) and "interface" in vars(c)
    )


def contract_violations(
    interface: type[Backend], result: object, request: Request[Any]
) -> list[str]:
    """Return one sentence for each violation of the interface by a result; empty for a valid
    result.
    """
    wrong_type = list(check_type(result, interface.Result))
    if wrong_type:
        return wrong_type
    try:
        return list(interface.check(result, request))
    except Exception as cause:  # fields of types that no check expects
        return [f"{type(result).__name__} cannot be read: {type(cause).__name__}: {cause}"]


def call(backend: Backend, request: Request[Any]) -> object:
    """Call ``infer`` of a backend with what it reads of a request, and return its unchecked result.

    Raises:
        InputError: the image of the request is invalid; the backend is not called.
    """
    require_image(request.image)
    return backend.infer(*request.arguments_read(backend.reads))
