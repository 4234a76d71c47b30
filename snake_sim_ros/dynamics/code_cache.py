# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The cache of compiled functions on disk, which belongs to exactly these sources and libraries.

Numba notices a change in the file of a function, but not in a function that it calls from another
file, and it keeps the code of every installation apart. Here a folder is named after the contents
of all modules in ROOMS and the versions of the compiler. Every installation of the same sources
finds it, and whatever is in it is up to date. What comes from another package, such as the
laboratory or a user's own method, is found by the contents of that package as well.

An installed package brings such a folder, SHIPPED, with what a start needs; see
`stepping.machine_code`. It is only read. All code is for one kind of processor, PORTABLE, if this
one is of that kind, and gives the same bits on all of them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import fcntl
from functools import cache
import hashlib
import os
from pathlib import Path
import platform
import shutil
import stat
import sys
import tempfile
from typing import Any, ClassVar, IO

import llvmlite
from llvmlite.binding import get_host_cpu_features
import numba
from numba.core import config
from numba.core.caching import (
    _CacheLocator,
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
)
import numpy as np

from snake_sim_ros.dynamics.linked_code import is_linked, load_linked
from snake_sim_ros.scene import PACKAGE

# Folders of all modules with compiled functions, and of the modules that these import.
ROOMS = ('scene', 'dynamics', 'gaits', 'contact', 'stepping')
OLDEST_NUMBA = 0, 60
COMPILERS = (numba, llvmlite, np)  # libraries that determine the code
GENERATIONS = 4  # folders of other sources that are kept, those that were used last
SHIPPED = PACKAGE / 'machine_code'  # folders of machine code that came with the package
MADE_FOR = 'made_for.txt'  # file in such a folder: what its code is for, as of `versions`
# x86_64 with AVX2 and FMA, from 2013 on. Code for the very processor would be no faster, and among
# pegs its bits depend on whether it has AVX-512.
PORTABLE = 'x86-64-v3'
PORTABLE_NEEDS = ('avx', 'avx2', 'bmi', 'bmi2', 'f16c', 'fma', 'lzcnt', 'movbe')


def is_portable() -> bool:
    """Return whether code is compiled for PORTABLE, as this processor can run it."""
    if 'NUMBA_CPU_NAME' in os.environ or platform.machine() not in ('x86_64', 'AMD64'):
        return False
    features = get_host_cpu_features()
    return all(features.get(name, False) for name in PORTABLE_NEEDS)


if is_portable():
    config.CPU_NAME, config.CPU_FEATURES = PORTABLE, ''


def versions() -> str:
    """Return for what code is compiled in this process, as a clause."""
    libraries = ', '.join(f'{library.__name__} {library.__version__}' for library in COMPILERS)
    python = '.'.join(map(str, sys.version_info[:2]))
    return f'Python {python}, {libraries} and {config.CPU_NAME or "this processor"}'


def identity(places: Sequence[str] = ROOMS) -> str:
    """
    Return a name for the contents of some modules, the compiler and its settings.

    Parameters
    ----------
    places : sequence of str
        Folders of the package, with all modules in them, or single modules.

    """
    digest = hashlib.sha256(f'{sys.implementation.cache_tag}\n'.encode())
    for name in sorted(name for name in os.environ if name.startswith('NUMBA_')):
        if name != 'NUMBA_CACHE_DIR':
            digest.update(f'{name} {os.environ[name]}\n'.encode())
    for library in COMPILERS:
        digest.update(f'{library.__name__} {library.__version__}\n'.encode())
    paths = [PACKAGE / place for place in places]
    files = [[path] if path.suffix == '.py' else path.rglob('*.py') for path in paths]
    for path in sorted(path for found in files for path in found):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        digest.update(f'{path.relative_to(PACKAGE)} {content}\n'.encode())
    return digest.hexdigest()[:16]


@cache
def sources_of(package: str) -> str:
    """Return a name for the contents of another package, or of the module with that name."""
    module = sys.modules.get(package)
    file = Path(getattr(module, '__file__', None) or '')
    if not file.is_file():  # typed at a prompt
        return ''
    digest = hashlib.sha256()
    for path in sorted(file.parent.rglob('*.py')) if hasattr(module, '__path__') else [file]:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def modules_of(kind: Any) -> Iterator[str]:
    """Yield the modules of all classes of tuples in a type of Numba."""
    if hasattr(kind, 'instance_class'):
        yield kind.instance_class.__module__
    for part in (*getattr(kind, 'kinds', ()), *getattr(kind, 'types', ())):
        yield from modules_of(part)


def cache_folder() -> Path | None:
    """
    Return the folder of these sources, which can be written; None if there is no such place.

    It is below NUMBA_CACHE_DIR or, without that, the user's cache folder. If that cannot be
    written, it is below a folder for temporary files, and belongs to this user alone.
    """
    home = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    private = Path(tempfile.gettempdir()) / f'cache-{os.getuid()}'
    for root in (Path(os.environ.get('NUMBA_CACHE_DIR') or home), private):
        folder = root / 'snake_sim_ros' / identity()
        try:
            if root == private:
                root.mkdir(mode=0o700, exist_ok=True)
                if not is_private(root):
                    continue
            is_new = not folder.exists()
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)  # It is used now, see `remove_old`.
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            if is_new:
                remove_old(folder)
            return folder
    return None


def is_private(folder: Path) -> bool:
    """Return whether a folder belongs to this user, and no other user can read or write it."""
    found = folder.lstat()
    others = stat.S_IRWXG | stat.S_IRWXO
    return (
        stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & others
    )


def remove_old(folder: Path) -> None:
    """Remove the folders of other sources beside this one, but those that were used last."""
    times = {}
    for path in folder.parent.iterdir():
        try:
            times[path] = path.stat().st_mtime
        except OSError:  # Another process removed it.
            continue
    newest = sorted(times, key=lambda path: times[path], reverse=True)
    for path in newest[GENERATIONS:]:
        if path != folder:
            shutil.rmtree(path, ignore_errors=True)


FOLDER = None if config.DISABLE_JIT else cache_folder()


def shipped_folder() -> Path | None:
    """Return the folder of machine code that came with the package; None if there is none."""
    folder = SHIPPED / identity()
    return folder if config.CPU_NAME == PORTABLE and folder.is_dir() else None


def why_compile() -> str:
    """
    Return why something is compiled that need not be, or takes minutes; empty if nothing is.

    It is an old compiler, or machine code that came with the package and is of no use.
    """
    if numba.version_info.short < OLDEST_NUMBA:
        return (
            f'numba {numba.__version__} compiles each scene for minutes: install numba '
            f'{".".join(map(str, OLDEST_NUMBA))} or newer'
        )
    made_for = sorted(SHIPPED.glob(f'*/{MADE_FOR}'))
    if not made_for or shipped_folder():
        return ''
    known, here = made_for[0].read_text(encoding='utf-8').strip(), versions()
    missing = 'but its sources have changed' if known == here else f'but not for {here}'
    return f'the package brings machine code for {known}, {missing}: it is compiled now'


SHIPPED_FOLDER = None if config.DISABLE_JIT else shipped_folder()


class Locator(_CacheLocator):  # type: ignore[misc]
    """Says where the code of a function is: with its module, wherever that is installed."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.module = function.__module__
        self.line = function.__code__.co_firstlineno
        self._py_file = function.__code__.co_filename  # for warnings of Numba

    def get_cache_path(self) -> str:
        """Return the folder of the module."""
        return str(FOLDER / self.module.rpartition('.')[0]) if FOLDER else ''

    def get_source_stamp(self) -> str:
        """Return nothing: the name of the folder says what the sources are."""
        return ''

    def get_disambiguator(self) -> str:
        """Return what distinguishes functions of the same name in one module."""
        return str(self.line)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> 'Locator':
        """Return the locator of a function."""
        return cls(py_func)


class _Form(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: ClassVar = [Locator]

    def reduce(self, data: Any) -> tuple[Any, ...]:
        """Return what is kept of compiled code, without its text, which names a folder."""
        return tuple('' if isinstance(part, str) else part for part in super().reduce(data))

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return compiled code from what is kept of it."""
        if is_linked(payload):
            return load_linked(target_context, payload)
        return super().rebuild(target_context, payload)


class CodeCache(FunctionCache):  # type: ignore[misc]
    """
    The cache of one function. Several processes may fill it at the same time.

    Attributes
    ----------
    shares_work : bool
        Whether this process waits for functions that another one of these processes compiles at
        the moment. It cannot deadlock, because no function calls itself.

    """

    _impl_class = _Form
    shares_work = False

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._lock: IO[str] | None = None
        self._shipped: Any = None
        if SHIPPED_FOLDER and function.__module__.startswith(PACKAGE.name):
            self._shipped = IndexDataCacheFile(
                str(SHIPPED_FOLDER / Path(self.cache_path).name), self._impl.filename_base, ''
            )

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """
        Return the key of Numba, with the contents of other packages that take part.

        Types are in it as text: an index of types could only be read where all packages that have
        ever taken part can be imported.
        """
        modules = {self._py_func.__module__, *(name for kind in sig for name in modules_of(kind))}
        others = {name.partition('.')[0] for name in modules} - {PACKAGE.name}
        _, *code = super()._index_key(sig, codegen)
        return (str(sig), *sorted(modules), *code, *map(sources_of, sorted(others)))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """
        Return the code for some types of arguments, or None: this process compiles it.

        The cache of Numba first initializes its whole compiler, which imports SciPy and takes
        longer than anything else at a start. What is only loaded needs none of it.
        """
        found = self._load_overload(sig, target_context)
        if found is None and self.shares_work and self._lock is None:
            types = hashlib.sha256(str(sig).encode()).hexdigest()[:16]
            path = Path(self.cache_path) / f'{self._impl.filename_base}-{types}.lock'
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = path.open('w')
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            found = self._load_overload(sig, target_context)
            if found is not None:
                self.unlock()
        return found

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for some types that came with the package or is in the user's folder."""
        if self._shipped:
            data = self._shipped.load(self._index_key(sig, target_context.codegen()))
            if data is not None:
                return self._impl.rebuild(target_context, data)
        return super()._load_overload(sig, target_context) if FOLDER else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the code for some types of arguments, if they can be written."""
        with suppress(OSError):  # There is no folder, it was deleted, or the disk is full.
            # Numba reads the index of a function, and then writes it with one more.
            with locked():
                super().save_overload(sig, data)
        self.unlock()

    def unlock(self) -> None:
        """Let other processes compile the function that this one had begun."""
        if self._lock:
            self._lock.close()
            self._lock = None


@contextmanager
def locked() -> Iterator[None]:
    """Make other processes that write to the folder wait."""
    if not FOLDER:
        raise FileNotFoundError('there is no folder for compiled code')
    with (FOLDER / 'lock').open('w') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
