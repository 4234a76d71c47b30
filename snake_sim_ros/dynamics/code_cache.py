# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The cache of compiled functions on disk, which belongs to exactly these sources and libraries.

Numba notices a change in the file of a function, but not in a function that it calls from another
file, and it keeps the code of every installation apart. Here a folder is named after the contents
of all modules in ROOMS and the versions of the compiler. Every installation of the same sources
finds it, and whatever is in it is up to date. What comes from another package, such as the
laboratory or a user's own method, is found by the contents of that package as well. All that
code depends on is in its path, so that there is no index of a function, as Numba has, to share.

An installed package brings such a folder in SHIPPED, with the machine code that a start needs;
see `stepping.machine_code`. It is only read, and has the name of the sources alone. All code is
for one kind of processor, PORTABLE, if this one is of that kind, and gives the same bits on all.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
import fcntl
from functools import cache
import hashlib
from importlib.metadata import PackageNotFoundError, version
import os
from pathlib import Path
import platform
import shutil
import stat
import sys
import tempfile
from typing import Any, ClassVar, IO

from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

from snake_sim_ros.scene import PACKAGE

DISABLED = os.environ.get('NUMBA_DISABLE_JIT', '0') not in ('', '0')  # nothing is compiled
# Folders of all modules with compiled functions, and of the modules that these import.
ROOMS = ('scene', 'dynamics', 'gaits', 'contact', 'stepping')
OLDEST_NUMBA = 0, 60
COMPILERS = ('numba', 'llvmlite', 'numpy')  # libraries that determine the code
GENERATIONS = 4  # folders of other sources that are kept, those that were used last
SHIPPED = PACKAGE / 'machine_code'  # folders of machine code that came with the package
SUFFIX = '.code'  # of a file of the code of a function
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


@cache
def processor_name() -> str:
    """Return the kind of processor that code is compiled for; empty for this very one."""
    return os.environ.get('NUMBA_CPU_NAME', PORTABLE if is_portable() else '')


def version_of(library: str) -> str:
    """Return the version of a library, empty if it is not installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return ''


def identity(places: Sequence[str] = ROOMS, libraries: Sequence[str] = COMPILERS) -> str:
    """
    Return a name for the contents of some modules, the processor, and what compiles them.

    Parameters
    ----------
    places : sequence of str
        Folders of the package, with all modules in them, or single modules.
    libraries : sequence of str
        Libraries whose versions count, with that of Python and the settings of Numba. Machine code
        that came with the package was compiled by whatever there was, and needs none of them.

    """
    host = f'{get_host_cpu_name()} {get_host_cpu_features().flatten()}'
    digest = hashlib.sha256(f'{processor_name() or host}\n'.encode())
    if libraries:
        settings = sorted(name for name in os.environ if name.startswith('NUMBA_'))
        lines = [f'{name} {os.environ[name]}' for name in settings if name != 'NUMBA_CACHE_DIR']
        lines += [f'{library} {version_of(library)}' for library in libraries]
        digest.update('\n'.join([str(sys.implementation.cache_tag), *lines]).encode())
    digest.update(contents_of(tuple(places)))
    return digest.hexdigest()[:16]


@cache
def contents_of(places: tuple[str, ...]) -> bytes:
    """Return a digest of modules of the package; a start asks for two identities with them."""
    paths = [PACKAGE / place for place in places]
    files = [[path] if path.suffix == '.py' else path.rglob('*.py') for path in paths]
    digest = hashlib.sha256()
    for path in sorted(path for found in files for path in found):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        digest.update(f'{path.relative_to(PACKAGE)} {content}\n'.encode())
    return digest.digest()


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


FOLDER = None if DISABLED else cache_folder()


def shipped_folder() -> Path | None:
    """Return the folder of machine code that came with the package; None if there is none."""
    folder = SHIPPED / identity(libraries=())
    return folder if processor_name() == PORTABLE and folder.is_dir() else None


def why_compile() -> str:
    """
    Return why something is compiled that need not be, or takes minutes; empty if nothing is.

    It is an old compiler, or machine code that came with the package and is of no use.
    """
    numba = version_of('numba')
    if numba and tuple(map(int, numba.split('.')[:2])) < OLDEST_NUMBA:
        return (
            f'numba {numba} compiles each scene for minutes: install numba '
            f'{".".join(map(str, OLDEST_NUMBA))} or newer'
        )
    if shipped_folder() or not any(SHIPPED.glob('*')):
        return ''
    here = 'its sources have changed' if is_portable() else 'this is an older or another processor'
    return f'the package brings machine code for {PORTABLE}, but {here}: it is compiled now'


SHIPPED_FOLDER = None if DISABLED else shipped_folder()


class Shelf:
    """
    The machine code of one function on disk: a file for each list of kinds of its arguments.

    Several processes may fill it at the same time: a file is there as a whole or not at all.

    Attributes
    ----------
    loaded : set of Path
        The files that this process has loaded, of all functions.
    shares_work : bool
        Whether this process waits for functions that another one of these processes compiles at
        the moment. It cannot deadlock, because no function calls itself.

    """

    loaded: ClassVar[set[Path]] = set()
    shares_work: ClassVar[bool] = False

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self._lock: IO[bytes] | None = None

    @property
    def room(self) -> str:
        """The folder of its module, below those of the sources."""
        return self.function.__module__.rpartition('.')[0]

    @property
    def can_keep(self) -> bool:
        """
        Whether the code can be found again by the sources of its module.

        What it refers to from a function around it, and what is typed at a prompt, is in none.
        """
        module = self.function.__module__
        return not self.function.__closure__ and (
            module.startswith(f'{PACKAGE.name}.') or bool(sources_of(module.partition('.')[0]))
        )

    def path(self, kinds: str, modules: set[str]) -> Path:
        """
        Return the path, below a folder of the sources, of the code for some kinds of arguments.

        The contents of other packages, with the `modules` of classes, are in its name.
        """
        module, code = self.function.__module__, self.function.__code__
        modules = modules | {module}
        others = {name.partition('.')[0] for name in modules} - {PACKAGE.name}
        key = [kinds, *sorted(modules), *map(sources_of, sorted(others))]
        digest = hashlib.sha256('\n'.join(key).encode()).hexdigest()[:16]
        file = module.rpartition('.')[2]
        name = f'{file}.{self.function.__qualname__}-{code.co_firstlineno}'
        return Path(self.room) / f'{name}-{digest}{SUFFIX}'

    def load(self, path: Path) -> bytes | None:
        """Return what a file has, or None: then this process compiles it."""
        if not self.can_keep:
            return None
        found = self._read(path)
        if found is None and self.shares_work and FOLDER and self._lock is None:
            file = (FOLDER / path).with_suffix('.lock')
            file.parent.mkdir(parents=True, exist_ok=True)
            self._lock = file.open('wb')
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            found = self._read(path)
            if found is not None:
                self.unlock()
        return found

    def _read(self, path: Path) -> bytes | None:
        """Return the code that came with the package or is in the user's folder, if any."""
        for folder in filter(None, (SHIPPED_FOLDER, FOLDER)):
            with suppress(FileNotFoundError):
                content = (folder / path).read_bytes()
                self.loaded.add(folder / path)
                return content
        return None

    def save(self, path: Path, content: bytes) -> None:
        """Save code, if it can be written."""
        if FOLDER and self.can_keep:
            target = FOLDER / path
            with suppress(OSError):  # The folder was deleted, or the disk is full.
                target.parent.mkdir(parents=True, exist_ok=True)
                with tempfile.NamedTemporaryFile(dir=target.parent, delete=False) as file:
                    file.write(content)
                os.replace(file.name, target)
        self.unlock()

    def unlock(self) -> None:
        """Let other processes compile the function that this one had begun."""
        if self._lock:
            self._lock.close()
            self._lock = None
