"""What a backend needs besides the weight sets that its options name, whether it is on this machine or not.

``physic setup`` makes its steps from these.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["GpuMemory", "Packages", "Repository", "Requirement", "UserFile"]


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
        name: of the project.
        url: for ``git clone``.
        commit: hexadecimal digits of the commit that the backend was tested with; "" if none was.
        folder: value of the option, "" if it is not set.
        found: commit of that folder; "" if it is no checkout.
        is_here: whether the code is there, or installed in the environment.
    """

    option: str
    name: str
    url: str
    commit: str = ""
    folder: str = ""
    found: str = ""
    is_here: bool = False


@dataclass(frozen=True)
class UserFile:
    """A file or a model that the user gets by hand.

    Attributes:
        option: option with its path; "" if no option is needed.
        name: of the file.
        advice: one line: where to register, which licence to accept, what to download.
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
