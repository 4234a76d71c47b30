# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mutants: wrong laws, one line each, and the test file that must notice every one of them.

    ./run python test/mutants.py                # all of them, in some minutes
    ./run python test/mutants.py rolling drift  # those of some laws

Each is applied to a copy of the package, and the file runs on the copy without the compiler. A
mutant that survives shows what the file does not check. Where the line of a mutant has changed,
the script says so, and the mutant is written anew. No mutant is wrong only in what an iteration
starts from or in its matrix: such a one costs iterations and changes no result.
"""

from collections.abc import Iterator
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
COPIED = ('snake_sim_ros', 'config', 'test', 'pyproject.toml')
ONE_STEP = 'stepping/test_one_step.py'
CHAINS = 'stepping/test_planar_chains.py'
CONDENSING = 'contact/test_condensing.py'
DIRECTIONS = 'dynamics/test_directions.py'
ROTATIONS = 'scene/test_rotations.py'
VISCOUS = 'contact/test_viscous_friction.py'
STRIBECK = 'contact/test_stribeck_friction.py'
KILLED, SURVIVED = 1, 0  # exit codes of pytest
LONGEST = 300  # time that a test file may take; one that does not end has failed, too [s]

# (law, module of the package, test file) -> parts of its lines, and what replaces them.
MUTANTS = {
    ('friction', 'contact/laws.py', ONE_STEP): (
        ('if P_x > 0.0 else', 'if P_x < 0.0 else'),
        (
            'floor.against_backward, floor.transversal',
            'floor.transversal, floor.against_backward',
        ),
        ('x * aa / (t', 'x * bb / (t'),
        ('a >= other.first_pair', 'a < other.first_pair'),
    ),
    ('friction', 'contact/linear_problem.py', ONE_STEP): (
        ('d_x, d_y = mu_x * x, mu_y * y', 'd_x, d_y = mu_y * x, mu_x * y'),
        ('+ proximal * anchor - gamma)', '+ proximal * anchor + gamma)'),
    ),
    ('friction', 'contact/directions.py', DIRECTIONS): (
        ('= cx * vy - cy * vx', '= cy * vx - cx * vy'),
    ),
    ('friction', 'stepping/planar/equilibrium.py', ONE_STEP): (
        ('load + lever, load - lever', 'load - lever, load + lever'),
    ),
    ('friction', 'stepping/planar/solvers.py', ONE_STEP): (
        ('P_y + Q_y, offset * (P_y - Q_y)', 'P_y + Q_y, offset * (P_y + Q_y)'),
    ),
    ('pegs', 'contact/detection.py', ONE_STEP): (('-ny, nx, 0.0', 'ny, nx, 0.0'),),
    ('rolling', 'contact/laws.py', ONE_STEP): (
        (
            'return other.rolling if a >= other.first_peg',
            'return other.rolling if a < other.first_peg',
        ),
    ),
    ('rolling', 'contact/delassus.py', CONDENSING): (
        ('turn = four(0.0, r, 0.0, 0.0), four(-r', 'turn = four(0.0, r, 0.0, 0.0), four(r'),
    ),
    ('rolling', 'contact/directions.py', CONDENSING): (
        (
            'z * py + geometry.radius[a] * solution.impulse[a, 4]',
            'z * py - geometry.radius[a] * solution.impulse[a, 4]',
        ),
    ),
    ('rolling', 'contact/directions.py', DIRECTIONS): (
        ('a, 3] = -geometry.radius[a] * wy', 'a, 3] = geometry.radius[a] * wy'),
    ),
    ('rolling', 'contact/directions.py', ONE_STEP): (
        ('solution.gamma[a, 4] = geometry.radius[a] * along', 'solution.gamma[a, 4] = along'),
    ),
    ('viscous', 'contact/laws.py', VISCOUS): (
        (
            'factor * other.viscous_x, factor * other.viscous_y',
            'factor * other.viscous_y, factor * other.viscous_x',
        ),
        ('factor = h * contacts.geometry.grip[a]', 'factor = h'),
    ),
    ('viscous', 'stepping/planar/equilibrium.py', VISCOUS): (
        ('A[0] += offset * offset * across', 'A[0] += offset * across'),
        ('across - c_y *', 'across + c_y *'),
    ),
    ('Stribeck', 'contact/laws.py', STRIBECK): (
        ('(x * x + y * y) / (speed', '(x * x - y * y) / (speed'),
        ('/ (speed * speed))', '/ speed)'),
    ),
    ('patches', 'contact/detection.py', ONE_STEP): (
        ('math.floor((y - patches.origin_y)', 'math.floor((x - patches.origin_y)'),
    ),
    ('patches', 'contact/detection.py', CHAINS): (('own * patch_factor', 'patch_factor'),),
    ('patches', 'contact/laws.py', ONE_STEP): (('factor = geometry.grip[a]', 'factor = 1.0'),),
    ('joint laws', 'dynamics/joint_laws.py', ONE_STEP): (
        ('axes.friction[j, k] = h * laws', 'axes.friction[j, k] = laws'),
        ('rate_on_slope(c + F, R, -F,', 'rate_on_slope(c - F, R, -F,'),
        ('(1.0 + r * (R + V))', '(1.0 + r * R)'),
        ('(high - hat) / h_q', '(high - angle) / h_q'),
        ('if angle >= laws.stop[j, k, 1]:', 'if angle >= laws.stop[j, k, 0]:'),
    ),
    ('joint laws', 'dynamics/joint_control.py', ONE_STEP): (
        ('damping / 2 + stiffness * dt / 4', 'damping + stiffness * dt / 4'),
    ),
    ('joint laws', 'dynamics/balance.py', ONE_STEP): (
        ('torque[j, 0] + c * torque[j, 1]', 'torque[j, 0] - c * torque[j, 1]'),
    ),
    ('drift', 'dynamics/joint_drift.py', ONE_STEP): (
        ('c * e2 + y * e0 + z * e1 - x * e3', 'c * e2 + y * e0 - z * e1 + x * e3'),
        ('s = sine * (0.5 +', 's = sine * (1.0 +'),
        ('q[i, 1] -= moment_y', 'q[i, 1] += moment_y'),
    ),
    ('rotation', 'dynamics/kinematics.py', ROTATIONS): (
        ('e2 + step * (e0 * y + e3 * x - e1 * z)', 'e2 + step * (e0 * y - e3 * x + e1 * z)'),
    ),
    ('rotation', 'scene/rotations.py', ROTATIONS): (
        ('a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0', 'a0 * b3 - a1 * b2 + a2 * b1 + a3 * b0'),
    ),
    ('rotation', 'dynamics/balance.py', ONE_STEP): (
        ('- slender * wy * wz', '+ slender * wy * wz'),
    ),
    ('rotation', 'dynamics/kinematics.py', ONE_STEP): (
        (
            'R[i, 0, 2] = 2.0 * s * (e1 * e3 + e0 * e2)',
            'R[i, 0, 2] = 2.0 * s * (e1 * e3 - e0 * e2)',
        ),
        ('pair(-xz, -yz)', 'pair(-xz, yz)'),
    ),
}


class Mutant(NamedTuple):
    """A change of one line of the package that makes a law wrong."""

    law: str
    module: str  # below the package
    test: str  # file in this folder that must fail
    line: str  # part of a line that is there once
    wrong: str  # what replaces it


def copy_of_the_project(folder: Path) -> None:
    """Copy what the tests need."""
    for name in COPIED:
        place = ROOT / name
        if place.is_dir():
            shutil.copytree(place, folder / name, symlinks=True)
        else:
            shutil.copy(place, folder)


def exit_code(folder: Path, test: str) -> int:
    """Return the exit code of a test file of the copy, which ends at its first failure."""
    path = os.pathsep.join([str(folder), str(folder / 'test'), os.environ.get('PYTHONPATH', '')])
    try:
        return subprocess.run(
            [sys.executable, '-m', 'pytest', '-qx', '-p', 'no:cacheprovider', f'test/{test}'],
            cwd=folder, env={**os.environ, 'PYTHONPATH': path, 'NUMBA_DISABLE_JIT': '1'},
            stdout=subprocess.DEVNULL, check=False, timeout=LONGEST,
        ).returncode  # fmt: skip
    except subprocess.TimeoutExpired:
        return KILLED


def verdicts(folder: Path, mutants: list[Mutant]) -> Iterator[tuple[Mutant, int]]:
    """Yield mutants with the exit codes of their tests, which pass without a mutant."""
    for test in dict.fromkeys(mutant.test for mutant in mutants):
        if exit_code(folder, test) != SURVIVED:
            raise SystemExit(f'{test} fails without a mutant')
    for mutant in mutants:
        path = folder / 'snake_sim_ros' / mutant.module
        text = path.read_text(encoding='utf-8')
        if text.count(mutant.line) != 1:
            raise SystemExit(f'{mutant.module} must have once: {mutant.line}')
        path.write_text(text.replace(mutant.line, mutant.wrong), encoding='utf-8')
        yield mutant, exit_code(folder, mutant.test)
        path.write_text(text, encoding='utf-8')


def main(laws: list[str]) -> int:
    """Print which mutants are killed; return how many are not."""
    every = [Mutant(*place, *change) for place, changes in MUTANTS.items() for change in changes]
    chosen = [mutant for mutant in every if not laws or mutant.law in laws]
    if not chosen:
        names = dict.fromkeys(mutant.law for mutant in every)
        raise SystemExit(f'choose from: {", ".join(names)}')
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        copy_of_the_project(Path(folder))
        for mutant, code in verdicts(Path(folder), chosen):
            word = {KILLED: 'killed', SURVIVED: 'SURVIVED'}.get(code, f'exit code {code}')
            survivors += code != KILLED
            print(f'{word:9} {mutant.law:10} {mutant.module}: {mutant.wrong}', flush=True)
    print(f'{len(chosen) - survivors} of {len(chosen)} killed')
    return survivors


if __name__ == '__main__':
    sys.exit(min(main(sys.argv[1:]), 1))
