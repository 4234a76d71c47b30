# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What random scenes found once stays mended."""

from pathlib import Path

import pytest
import yaml

from snake_sim_ros.reliability import physics

# Cases as `snake-sim fuzz` prints them.
FOUND = sorted((Path(__file__).parent / 'data' / 'found').glob('*.yaml'))


@pytest.mark.parametrize('path', FOUND, ids=lambda path: path.stem)
def test_what_was_found_stays_mended(path):
    case = yaml.safe_load(path.read_text(encoding='utf-8'))['case']
    assert physics.judged(case).broken == []
