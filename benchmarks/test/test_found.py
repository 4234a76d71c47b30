# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What random scenes found once stays mended."""

from pathlib import Path

from processes import python
import pytest

ROOT = Path(__file__).resolve().parents[2]
# Cases as `./run fuzz` prints them.
FOUND = sorted((Path(__file__).parent / 'found').glob('*.yaml'))
# Without the compiler: each case would be compiled anew, which takes longer than to run it.
JUDGE = """
from pathlib import Path
import sys
import yaml
from snake_sim_benchmarks.reliability import physics
print(physics.judged(yaml.safe_load(Path(sys.argv[1]).read_text(encoding='utf-8'))['case']).broken)
"""


@pytest.mark.parametrize('path', FOUND, ids=lambda path: path.stem)
def test_what_was_found_stays_mended(path):
    assert python('-c', JUDGE, str(path), folder=ROOT, NUMBA_DISABLE_JIT='1') == '[]\n'
