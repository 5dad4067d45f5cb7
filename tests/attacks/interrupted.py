"""End a write at any of its steps: as a killed process, as Ctrl-C, or by an error of the disk."""

from __future__ import annotations

import builtins
import errno
import io
import os
from contextlib import contextmanager

import pytest


class Killed(BaseException):
    """The process has ended: nothing that it does from here on has an effect."""


class Steps:
    """Counts the steps of a write (open, write, synchronise, rename, delete), and ends it at one of
    them.

    Args:
        folder: whose files count.
        last: number of the step that fails; None for a count only.
        how: "killed": the step and all after it do nothing. "full": this one step raises OSError,
            and only writes are steps. "interrupted": this one step raises KeyboardInterrupt, as
            Ctrl-C does. A name of :mod:`errno`: this one step raises OSError, and with "EROFS" all
            after it. A function: it is called before this one step.
    """

    def __init__(self, folder, last=None, how="killed"):
        self.folder = str(folder)
        self.last = last
        self.how = how
        self.count = 0
        self.is_dead = False

    def step(self, path, *, is_write=False):
        """Count a step on a path, and fail if it is the last one."""
        if not str(path).startswith(self.folder) or (self.how == "full" and not is_write):
            return
        is_last = self.count == self.last
        self.count += 1
        if is_last or self.is_dead:
            self._fail()

    def _fail(self):
        self.is_dead = self.how in ("killed", "EROFS")
        if callable(self.how):
            self.how()
        elif self.how == "killed":
            raise Killed
        elif self.how == "interrupted":
            raise KeyboardInterrupt
        else:
            number = errno.ENOSPC if self.how == "full" else getattr(errno, self.how)
            raise OSError(number, os.strerror(number))

    @contextmanager
    def applied(self):
        """Count and fail within the block."""
        with pytest.MonkeyPatch.context() as patch:
            opened = {}
            real_open = io.open

            def open_(path, mode="r", *args, **options):
                is_ours = isinstance(path, str | os.PathLike) and str(path).startswith(self.folder)
                if not is_ours or not set(mode) & set("wax+"):
                    return real_open(path, mode, *args, **options)
                self.step(path)
                file = real_open(path, mode, *args, **options)
                opened[file.fileno()] = str(path)
                return _File(file, str(path), self)

            def stepped(real):
                def call(path, *args, **options):
                    # of shutil.rmtree, whose paths are relative
                    self.step(self.folder if "dir_fd" in options else path)
                    return real(path, *args, **options)

                return call

            for module in (io, builtins):
                patch.setattr(module, "open", open_)
            patch.setattr(os, "fsync", lambda file: self.step(opened[file]))
            for name in ("mkdir", "replace", "rename", "rmdir", "unlink"):
                patch.setattr(os, name, stepped(getattr(os, name)))
            try:
                yield
            except Killed:
                assert self.is_dead


class _File:
    """A file whose writes are steps."""

    def __init__(self, file, path, steps):
        self._file = file
        self._path = path
        self._steps = steps

    def write(self, content):
        self._steps.step(self._path, is_write=True)
        return self._file.write(content)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()

    def __iter__(self):
        return iter(self._file)

    def __getattr__(self, name):
        return getattr(self._file, name)
