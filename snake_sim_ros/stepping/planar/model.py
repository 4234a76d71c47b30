"""The numbers of a scene and the arrays of a step in the plane, as compiled code takes them."""

from typing import Any
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.contact.table import make_table
from snake_sim_ros.dynamics.compilation import record_array
from snake_sim_ros.dynamics.hinge_chain import HingeChain
from snake_sim_ros.dynamics.joint_drift import CENTER_OF_MASS
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.obstacles import first_peg
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import DRIFT_CORRECTIONS
from snake_sim_ros.scene.parameters import PD_SCHEMES
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.model import make_model
from snake_sim_ros.stepping.state import named_arrays

# How a robot stands after a step, see find_loads and is_planar.
STANDING = np.dtype(
    [
        ('least_load', float),  # smallest normal impulse [N s]
        ('roll', float),  # largest roll of a link, with the sign of that of the middle link [rad]
        ('part', float),  # part of a step over which the loads act
        ('rolls', np.int64),  # whether its roll is all that is not planar
    ]
)
ROLL_LIMIT = (
    1e-3  # roll of the robot at which it does not lie flat, and that is always left out [rad]
)
SLIP_SHARE = 5e-3  # share of the way up to which the slip by rolling is left out


class PlanarMemory(NamedTuple):
    """
    What a stepper in the plane keeps of the last step.

    The Euler parameters of a state are made of planar coordinates. These are kept, so that they
    need not be read back, and steps in several calls are the same to the bit.
    """

    known: Array  # (1,) whether the coordinates are those of the last step
    q: Array  # (n+2,) center of link 1 [m] and headings of all links [rad]
    u: Array  # (n, 3) velocities [m/s] and turning rates [rad/s]
    tilt: Array  # (n, 4) Euler parameters of links without their heading
    # The largest roll of a link, with the sign of that of the middle link [rad], and the slip and
    # the way up to there [m], see moreau.rolls_too_far. The last two are kept while the robot is
    # at the spatial level.
    roll: Array  # (1,)
    slip: Array  # (1,)
    way: Array  # (1,)
    scheme: Any  # what the method itself keeps, a NamedTuple of arrays, or None

    def last_span(self) -> float:
        """Return the time that the last impulses acted for [s], 0 before the first step."""
        return float(self.scheme.last_span()) if self.scheme else 0.0


def make_planar_memory(n: int, scheme: Any = None) -> PlanarMemory:
    """Return the memory before the first step, for n links."""
    one = np.zeros((4, 1))
    q, u, tilt = np.zeros(n + 2), np.zeros((n, 3)), np.zeros((n, 4))
    return PlanarMemory(one[0], q, u, tilt, one[1], one[2], one[3], scheme)


def forget(memory: PlanarMemory) -> None:
    """Erase what is kept of the last step, in place, but not what was slipped up to there."""
    for name, array in named_arrays(memory, '').items():
        if name not in ('.slip', '.way'):
            array[:] = 0.0


class PlanarModel(NamedTuple):
    """The numbers of a scene as the compiled step takes them; names as in `parameters`."""

    half_length: Array
    mass: Array
    inertia: Array  # (n,) about the vertical
    inertia_axial: Array
    offset: Array
    radius: float  # of all contact spheres
    stiffness: Array  # (n-1,) of the yaw joints
    damping: Array
    hold: Array  # (n-1,) share of a pitch joint in holding the robot
    lean: float  # roll [rad] for a unit of turning about a horizontal axis
    fall: float  # vertical velocity that the weight adds in a step [m/s]
    share: Array  # (n,) of every link in the point that section VII-C holds
    laws: Laws
    dt: float
    tolerance: float
    residual_tolerance: float
    iteration_limit: int
    most_lean: float  # roll that is too much to be left out [rad]
    most_slip: float  # share of the way of the center of mass up to which its slip is left out
    held: bool  # whether pitch joints hold the robot; if not, what they let roll is rounding
    patient: bool  # whether steps that do not converge are taken, and counted
    pd_scheme: int
    keeps_center: bool  # whether that is the center of mass, and not link 1
    pegs: Array  # (pegs, 3) x, y, radius [m]
    first_peg: int  # number of the first contact with a peg
    activation_tolerance: float


class PlanarWorkspace(NamedTuple):
    """Arrays that the step fills, made once; the plane is that of the link centers."""

    heading: Array  # (n, 2) direction of every link
    center: Array  # (n, 2) of every link, from O, the center of the middle link
    torque: Array  # (n-1,) impulse of the controller, without its implicit part [N m s]
    momentum: Array  # (n, 3) impulse wrench of everything but contacts and torques
    bare: Array  # (n, 6) inertia of the links about O
    applied: Array  # (n-1, 2) impulse of the joints with the implicit part [N m s]
    impact: Array  # (n, 3) momentum out of the plane that the first step takes up
    weight: Array  # (n, 3) load out of the plane of everything but the contacts
    no_torque: Array  # (n-1,) zero
    chain: HingeChain  # in the plane
    upright: HingeChain  # out of it, with a spring at each contact
    closed: Array  # (c,) numbers of the closed contacts, first the 2n with the floor
    contacts: Any  # (c,) records of all contacts, see table
    twist: Array  # (n, 3) the last twists in the plane
    standing: Any  # (1,) a record of STANDING


# Share of a contact's stiffness with which the pitch joints hold the robot while loads are found:
# so small that they carry nothing else, so large that rounding does not matter.
HOLD = 1e-5
LIMP_STIFFNESS = 1e-6  # pitch stiffness that holds nothing but what rounding makes roll [N m/rad]


def make_planar_model(scene: Scene) -> PlanarModel:
    """Return the numbers of a scene as the compiled step takes them."""
    spatial, n = make_model(scene), scene.robot.link_count
    half, mass, dt = spatial.half_length, spatial.mass, scene.dt
    stiffness, damping = spatial.stiffness, spatial.damping
    pitch = stiffness[:, 1]
    stiffest = pitch.max(initial=LIMP_STIFFNESS)
    hold = HOLD * float(half.min()) ** 2
    keeps_center = scene.drift_correction == DRIFT_CORRECTIONS[CENTER_OF_MASS]
    share = mass / mass.sum() if keeps_center else np.eye(n)[0]
    return PlanarModel(
        half_length=half,
        mass=mass,
        inertia=spatial.inertia_transversal,
        inertia_axial=spatial.inertia_axial,
        offset=spatial.contact_offset,
        radius=float(spatial.contact_radius[0]),
        stiffness=np.ascontiguousarray(stiffness[:, 0]),
        damping=np.ascontiguousarray(damping[:, 0]),
        hold=hold * pitch / stiffest,
        lean=hold / (stiffest * dt),
        fall=dt * scene.gravity[2],
        share=share,
        laws=spatial.laws._replace(compliance=0.0),
        dt=dt,
        tolerance=scene.solver.tolerance,
        residual_tolerance=scene.solver.residual_tolerance,
        iteration_limit=scene.solver.iteration_limit,
        most_lean=ROLL_LIMIT,
        most_slip=SLIP_SHARE,
        held=bool(pitch.max(initial=0.0) > LIMP_STIFFNESS),
        patient=True,
        pd_scheme=PD_SCHEMES.index(scene.pd_scheme),
        keeps_center=keeps_center,
        pegs=scene.pegs.axes,
        first_peg=first_peg(scene),
        activation_tolerance=scene.solver.activation_tolerance,
    )


def make_planar_workspace(scene: Scene) -> PlanarWorkspace:
    """Return the arrays of the compiled step for a scene."""
    n, count = scene.robot.link_count, contact_count(scene)
    closed = np.zeros(count, np.int64)
    closed[: 2 * n] = np.array([[i, n + i] for i in range(n)]).ravel()
    return PlanarWorkspace(
        heading=np.zeros((n, 2)),
        center=np.zeros((n, 2)),
        torque=np.zeros(n - 1),
        momentum=np.zeros((n, 3)),
        bare=np.zeros((n, 6)),
        applied=np.zeros((n - 1, 2)),
        impact=np.zeros((n, 3)),
        weight=np.zeros((n, 3)),
        no_torque=np.zeros(n - 1),
        chain=make_chain(n),
        upright=make_chain(n),
        closed=closed,
        contacts=make_table(count),
        twist=np.zeros((n, 3)),
        standing=record_array(1, STANDING),
    )


def make_chain(n: int) -> HingeChain:
    """Return the arrays of a chain of n links."""
    return HingeChain(
        axis=np.zeros((n - 1, 3)),
        damping=np.zeros(n - 1),
        inertia=np.zeros((n, 6)),
        left=np.zeros((n - 1, 3)),
        compliance=np.zeros(n - 1),
        load=np.zeros(n - 1),
        wrench=np.zeros((n, 3)),
        rate=np.zeros(n - 1),
        twist=np.zeros((n, 3)),
    )
