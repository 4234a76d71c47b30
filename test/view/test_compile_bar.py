# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The count that `run` in Python shows while it compiles."""

import pytest

from snake_sim_ros import Simulation
from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.view.compile_bar import compile_with_bar


@pytest.mark.parametrize('scene', ['lateral_undulation', 'sidewinding'])  # in the plane, in space
def test_a_bar_is_shown_if_something_compiles(scene, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(code_cache, 'FOLDER', tmp_path)
    simulation = Simulation(load_scene(scene))
    monkeypatch.setattr(simulation, 'compile', lambda *_, **__: None)
    compile_with_bar(simulation)
    assert not capfd.readouterr().err

    @compiled
    def begin_step(x):
        return 2.0 * x

    monkeypatch.setattr(simulation, 'compile', lambda *_, **__: begin_step(1.5))
    compile_with_bar(simulation)
    assert 'compiling for 00:00, ' in capfd.readouterr().err
