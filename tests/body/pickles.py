"""Pickles of objects of packages that need not be here."""

from __future__ import annotations

import pickle


class As:
    """Is pickled as a call of somebody else's function, or as their class with a state."""

    def __init__(self, module, name, arguments, state=None):
        self.called = (Name(module, name), arguments, *(() if state is None else (state,)))

    def __reduce__(self):
        return self.called


class Name:
    """Stands for a function while it is pickled."""

    def __init__(self, module, name):
        self.__module__ = module
        self.__qualname__ = name

    def __call__(self, *_):
        raise AssertionError


class Writer(pickle._Pickler):
    """Writes names that nothing here needs to have."""

    def save(self, obj, save_persistent_id=True):
        if isinstance(obj, Name):
            self.write(b"c" + obj.__module__.encode() + b"\n" + obj.__qualname__.encode() + b"\n")
        else:
            super().save(obj, save_persistent_id)


def pickled(path, thing):
    with path.open("wb") as stream:
        Writer(stream, 2).dump(thing)
    return path


def instance(module, name, state):
    """An object of a class of Python 2."""
    call = (Name(module, name), Name("__builtin__", "object"), None)
    return As("copy_reg", "_reconstructor", call, state)


def chumpy(x):
    """An array of chumpy."""
    return instance("chumpy.ch", "Ch", {"x": x})


def select(whole, idxs, shape):
    """A choice of chumpy's from one of its arrays."""
    state = {"a": whole, "idxs": idxs, "preferred_shape": shape}
    return instance("chumpy.reordering", "Select", state)
