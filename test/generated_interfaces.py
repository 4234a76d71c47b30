# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Python messages from the definitions of a ROS 2 package that is not on PyPI.

``python test/generated_interfaces.py SOURCE TARGET`` makes a Python package in the folder TARGET
of the folders `msg`, `srv` and `action` in SOURCE, whose name is that of the package. Generators
and libraries of other messages are those of the wheels; a C++ compiler is needed. Only what Python
and Fast DDS need is made, into the folder of the Python package.
"""

from contextlib import contextmanager
import json
from multiprocessing.pool import ThreadPool
from pathlib import Path
import shutil
import subprocess
import sys
import sysconfig
import tempfile

import numpy as np
from rosidl_adapter import convert_to_idl
from rosidl_generator_c import generate_c
from rosidl_generator_py import generate_py
from rosidl_generator_type_description import generate_type_hash
from rosidl_typesupport_c import generate_c as generate_dispatch
from rosidl_typesupport_fastrtps_c import generate_typesupport_fastrtps_c
from rosidl_typesupport_introspection_c import generate_c as generate_introspection

PREFIX = Path(sys.prefix)
KINDS = ('msg', 'srv', 'action')
SUPPORTS = ('rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c')
MESSAGES, DISPATCH, PYTHON = 'rosidl_generator_c', 'rosidl_typesupport_c', 'rosidl_generator_py'
GENERATORS = {
    MESSAGES: generate_c,
    SUPPORTS[0]: generate_typesupport_fastrtps_c,
    SUPPORTS[1]: generate_introspection,
    DISPATCH: lambda file: generate_dispatch(file, list(SUPPORTS)),
    PYTHON: lambda file: generate_py(file, [DISPATCH]),
}


@contextmanager
def arguments(folder, **values):
    """Yield the name of a file with arguments of a generator."""
    with tempfile.NamedTemporaryFile('w', dir=folder, suffix='.json', delete=False) as file:
        json.dump(values, file)
    yield file.name


def generate(source, folder):
    """Generate the code of a package, of each generator into a folder of its name."""
    name = source.name
    definitions = [file for kind in KINDS for file in sorted(source.glob(f'{kind}/*.{kind}'))]
    if not definitions:
        raise SystemExit(f'there are no definitions in {source}/msg, srv or action')
    described = folder / 'definitions'
    for file in definitions:
        convert_to_idl(source, name, file.relative_to(source), described)
    files = [file.relative_to(described) for file in sorted(described.glob('*/*.idl'))]
    given = {
        'package_name': name,
        'idl_tuples': [f'{described}:{file}' for file in files],
        'target_dependencies': [],
        'output_dir': str(described),
    }
    known = [path for path in (PREFIX / 'share').iterdir() if (path / 'msg').is_dir()]
    included = [f'{path.name}:{path}' for path in known]
    with arguments(folder, **given, include_paths=included) as file:
        generate_type_hash(file)
    given['type_description_tuples'] = [
        f'{file}:{described / file.with_suffix(".json")}' for file in files
    ]
    for generator, run in GENERATORS.items():
        templates, made = PREFIX / 'share' / generator / 'resource', folder / generator / name
        for kind in {file.parent for file in files} | {Path('msg')}:
            (made / kind).mkdir(parents=True)
        own = {**given, 'template_dir': str(templates), 'output_dir': str(made)}
        with arguments(folder, **own) as file:
            run(file)
        for template in templates.glob('*visibility_control.h.in'):
            text = template.read_text().replace('@PROJECT_NAME@', name)
            text = text.replace('@PROJECT_NAME_UPPER@', name.upper())
            (made / 'msg' / template.stem).write_text(text)


def compile_libraries(name, folder, target):
    """Compile the generated code of a package into the libraries that Python loads."""
    includes = [PREFIX / 'include', *(PREFIX / 'include').iterdir()]
    includes += [folder / generator for generator in GENERATORS]
    includes += [np.get_include(), sysconfig.get_path('include')]
    flags = ['-fPIC', '-O0', '-w', *(f'-I{path}' for path in includes)]

    def compiled(file):
        compiler = ['g++', '-std=c++17'] if file.suffix == '.cpp' else ['gcc']
        subprocess.run([*compiler, *flags, '-c', file, '-o', f'{file}.o'], check=True)
        return f'{file}.o'

    def linked(library, generators, needed):
        sources = [file for each in generators for file in (folder / each).rglob('*.c*')]
        with ThreadPool() as pool:
            objects = pool.map(compiled, sources)
        places = [f'-Wl,-rpath,$ORIGIN:{PREFIX / "lib"}', f'-Wl,-soname,{library}']
        run = ['g++', '-shared', *objects, '-o', target / library, *places, '-Wl,--no-as-needed']
        subprocess.run([*run, *needed], check=True)
        return target / library

    of_ros = [*sorted((PREFIX / 'lib').glob('libros*.so')), PREFIX / 'lib' / 'libfastcdr.so']
    others = {
        each: sorted((PREFIX / 'lib').glob(f'lib*__{each}.so'))
        for each in (MESSAGES, PYTHON, DISPATCH, *SUPPORTS)
    }
    messages = linked(f'lib{name}__{MESSAGES}.so', [MESSAGES], [*of_ros, *others[MESSAGES]])
    supports = [
        linked(f'lib{name}__{each}.so', [each], [messages, *of_ros, *others[each]])
        for each in SUPPORTS
    ]
    module = f'{name}_s__{DISPATCH}{sysconfig.get_config_var("EXT_SUFFIX")}'
    needed = [messages, *supports, *of_ros, *others[DISPATCH], *others[PYTHON]]
    linked(module, [DISPATCH, PYTHON], [*needed, *others[MESSAGES]])


def main():
    """Make the package of the command line."""
    source, target = (Path(each).resolve() for each in sys.argv[1:])
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        generate(source, folder)
        made = folder / PYTHON / source.name
        compile_libraries(source.name, folder, made)
        for file in (*made.rglob('*.c'), *made.rglob('*.o')):
            file.unlink()
        (made / '__init__.py').touch()
        target.mkdir(parents=True, exist_ok=True)
        for kind in KINDS:  # bags have the definitions of their messages
            if (source / kind).is_dir():
                shutil.copytree(source / kind, target / 'share' / source.name / kind)
        shutil.move(made, target / source.name)


if __name__ == '__main__':
    main()
