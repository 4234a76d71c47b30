# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Package metadata, read by pip and by colcon alike."""

from glob import glob
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
import os
from pathlib import Path
import platform
import shutil
import subprocess
import sys

from setuptools import Distribution, find_packages, setup
from setuptools.command.build_py import build_py

package_name = 'snake_sim_ros'
# The folder of the sources: colcon runs a link to this file elsewhere with --symlink-install.
here = Path(__file__).resolve().parent

# ROS comes from package.xml where ROS 2 is installed. These wheels are for machines without it:
# in install_requires they would shadow a sourced installation.
ros_wheels = {
    'jazzy': [
        'ros-jazzy-rclpy[fastrtps]==7.1.6',
        'ros-jazzy-diagnostic-msgs==5.3.6',
        'ros-jazzy-geometry-msgs==5.3.6',
        'ros-jazzy-nav-msgs==5.3.6',
        'ros-jazzy-sensor-msgs==5.3.6',
        'ros-jazzy-std-srvs==5.3.6',
        'ros-jazzy-trajectory-msgs==5.3.6',
        'ros-jazzy-visualization-msgs==5.3.6',
    ],
}
plots = ['matplotlib>=3.5,<4', 'Pillow>=9.1']
# MCAP files and the messages in them, in Python alone, by those who define the format.
bags = 'mcap-ros2-support>=0.5,<1'
# Meshes of a URDF, of which the bounds are read; needs NumPy alone, for STL, OBJ and PLY.
meshes = 'trimesh>=4.6,<6'
# A page with 3-D, plots and controls that call back, served from one wheel of 4 MB.
viewer = 'viser>=1.1,<2'
# ffmpeg as a wheel of 30 MB; later versions have one of 70 MB.
video = 'imageio-ffmpeg>=0.4.9,<0.7'
# Tables of studies: polars writes Parquet and CSV, sorts and selects, and needs no other package,
# in a wheel as large as that of pyarrow, 50 MB. Clusters: Dask without its arrays and data frames.
# Optimization: CMA-ES in 3 MB; a tenth of the overhead of Optuna, whose packages have 40 MB.
studies = ['polars>=1,<3', 'distributed>=2023.5', 'cma>=4,<5']
# Environments: the interface that learning libraries agree on, in 1 MB.
learn = 'gymnasium>=1,<2'
# The examples of PPO: PyTorch, of which pip takes a build of several GB where none is installed.
train = 'stable-baselines3>=2.9,<3'
# The site: Sphinx, which rosdoc2 runs as well, with its theme and pages in Markdown.
docs = ['sphinx>=7', 'myst-parser>=3', 'sphinx-rtd-theme>=2']

oldest_numba = (0, 60)  # older ones compile each scene for minutes


def has_numba():
    """Return whether there is a numba that compiles in time."""
    try:
        return tuple(map(int, version('numba').split('.')[:2])) >= oldest_numba
    except PackageNotFoundError:
        return False


# With 0 the package brings no machine code, and compiles what a start needs on the user's machine.
brings_machine_code = (
    os.environ.get('SNAKE_SIM_MACHINE_CODE', '1') != '0'
    and platform.machine() == 'x86_64'
    and has_numba()
    and all(find_spec(name) for name in ('scipy', 'tqdm', 'yaml'))
)


class WithMachineCode(Distribution):
    """Makes wheels for one kind of processor."""

    def has_ext_modules(self):
        """Return whether the package brings machine code."""
        return brings_machine_code


class BuildWithMachineCode(build_py):
    """Compiles the steps, so that an installed package starts without its compiler."""

    def run(self):
        """Build the package; then compile it, which takes two minutes of two cores."""
        super().run()
        if not brings_machine_code or getattr(self, 'editable_mode', False):
            return
        library = Path(self.build_lib).resolve()
        target = library / package_name / 'machine_code'
        shutil.rmtree(target, ignore_errors=True)
        command = [sys.executable, '-m', f'{package_name}.stepping.machine_code', str(target)]
        path = os.pathsep.join([str(library), *filter(None, sys.path)])  # pip adds folders to it
        # The wheel has sources and machine code, and no bytecode of this Python beside them.
        environment = {**os.environ, 'PYTHONPATH': path, 'PYTHONDONTWRITEBYTECODE': '1'}
        done = subprocess.run(command, cwd=library, env=environment)
        if done.returncode:
            print('the package brings no machine code: it compiles when it first starts')


setup(
    # Machine code has nothing of Python in it: one wheel serves 3.10 and all later versions.
    options={'bdist_wheel': {'py_limited_api': 'cp310'}} if brings_machine_code else {},
    cmdclass={'build_py': BuildWithMachineCode},
    distclass=WithMachineCode,
    name=package_name,
    version='1.0.0',
    description='Simulation of snake robots without wheels: rigid contact, exact friction.',
    maintainer='snake_sim_ros maintainers',
    maintainer_email='maintainers@users.noreply.github.com',
    long_description=(here / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    keywords=['snake robot', 'nonsmooth dynamics', 'friction', 'simulation', 'ROS 2'],
    classifiers=[
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering :: Physics',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=[f'{package_name}*']),
    package_data={package_name: ['config/*', 'py.typed', '*.pyi']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', sorted(glob('config/*'))),
        (f'share/{package_name}/examples', sorted(glob('examples/*.*'))),
        (f'share/{package_name}/launch', sorted(glob('launch/*.launch.py'))),
        # What `ros2 run` finds after a pip install, which puts console scripts elsewhere.
        (f'lib/{package_name}', sorted(glob('scripts/*'))),
    ],
    zip_safe=False,
    install_requires=[
        'setuptools',
        'numpy>=1.23,<3',
        'scipy>=1.9,<2',
        'numba>=0.60,<0.69',  # and llvmlite, which it needs, too
        'PyYAML>=5.4,<7',
        'tqdm>=4.60,<5',
    ],
    extras_require={
        **ros_wheels,
        'plots': plots,
        'bags': [bags],
        'urdf': [meshes],
        'viewer': [viewer],
        'video': [video],
        'studies': studies,
        'learn': [learn],
        'train': [learn, train],
        'docs': docs,
        'test': [
            'pytest>=7',
            'pytest-xdist',
            'hypothesis',
            'import-linter>=2.5',
            'ruff',
            'mypy',
            'types-PyYAML',
            'wheel',
            'rosbags',  # another reader of bags
            *plots,
            bags,
            meshes,
            viewer,
            video,
            *studies,
            learn,
            # Another reader of URDF files; 3.11 is its first Python.
            'mujoco-core>=4,<5; python_version >= "3.11"',
        ],
    },
    entry_points={
        'console_scripts': [
            f'control = {package_name}.nodes.__main__:control',
            f'follow = {package_name}.nodes.__main__:follow',
            f'gait = {package_name}.nodes.__main__:gait',
            f'sim = {package_name}.nodes.__main__:sim',
            f'snake-sim = {package_name}.commands.main:main',
            f'viewer = {package_name}.nodes.__main__:viewer',
        ],
    },
)
