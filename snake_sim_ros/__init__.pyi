# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The public names: the only list of them, for type checkers and editors and at run time."""

from snake_sim_ros.api.runs import (
    load_scene as load_scene,
    read_run as read_run,
    Run as Run,
    run as run,
    table_of as table_of,
)
from snake_sim_ros.controllers.compliance import ShapeCompliance as ShapeCompliance
from snake_sim_ros.controllers.controller import Controller as Controller, Measured as Measured
from snake_sim_ros.controllers.following import PathFollower as PathFollower
from snake_sim_ros.controllers.obstacle_aided import ObstacleAided as ObstacleAided
from snake_sim_ros.controllers.oscillators import (
    CentralPatternGenerator as CentralPatternGenerator,
)
from snake_sim_ros.controllers.paths import PlanarPath as PlanarPath
from snake_sim_ros.scene import __version__ as __version__
from snake_sim_ros.scene.chain import Joint as Joint, Link as Link, Mesh as Mesh, Shape as Shape
from snake_sim_ros.scene.checked_records import ParameterError as ParameterError
from snake_sim_ros.scene.following import Following as Following
from snake_sim_ros.scene.gait import Gait as Gait, Table as Table, Wave as Wave
from snake_sim_ros.scene.gait_library import (
    Concertina as Concertina,
    EelLike as EelLike,
    LateralUndulation as LateralUndulation,
    LinearProgression as LinearProgression,
    Rolling as Rolling,
    RollingHelix as RollingHelix,
    Sidewinding as Sidewinding,
    TurnInPlace as TurnInPlace,
)
from snake_sim_ros.scene.parameters import (
    Friction as Friction,
    Ground as Ground,
    load_robot as load_robot,
    Patches as Patches,
    Pegs as Pegs,
    Push as Push,
    Robot as Robot,
    Scene as Scene,
    Solver as Solver,
    Start as Start,
)
from snake_sim_ros.scene.world import (
    Box as Box,
    EggCrate as EggCrate,
    HeightField as HeightField,
    Pipe as Pipe,
    Pole as Pole,
    Ramp as Ramp,
    Stairs as Stairs,
    TriangleMesh as TriangleMesh,
    World as World,
)
from snake_sim_ros.stepping.base import Report as Report
from snake_sim_ros.stepping.simulation import Simulation as Simulation
from snake_sim_ros.stepping.state import State as State
from snake_sim_ros.studies.study import study as study

__all__: list[str]
