"""What a compiled loop reports of its steps: an array of numbers, and the record made of it."""

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import divergence
from snake_sim_ros.stepping.base import Report

# Columns of the report array.
STEPS, ITERATIONS, ITERATIONS_MAX, UNCONVERGED, FALLBACKS, RESIDUAL, PRINTED_RESIDUAL = range(7)
PENETRATION, GAP_MAX, TWIST_MAX, CONTACTS, FAILED_LINK, FAILED_VALUE, LEFT = range(7, 14)
REPORT_SIZE = 14


@inlined
def note_outcome(outcome, report):
    """Add to the report what a contact solver returned."""
    iterations, converged, residual, printed_residual, fell_back = outcome
    report[ITERATIONS] += iterations
    report[ITERATIONS_MAX] = max(report[ITERATIONS_MAX], iterations)
    report[UNCONVERGED] += not converged
    report[FALLBACKS] += fell_back
    report[RESIDUAL] = max(report[RESIDUAL], residual)
    report[PRINTED_RESIDUAL] = max(report[PRINTED_RESIDUAL], printed_residual)


def report_from(numbers: Array, applied: Array, dt: float) -> Report:
    """Return what the compiled step gathered, and the joint torques of impulses in a step."""
    report = Report(
        steps=int(numbers[STEPS]),
        iterations=int(numbers[ITERATIONS]),
        iterations_max=int(numbers[ITERATIONS_MAX]),
        unconverged=int(numbers[UNCONVERGED]),
        fallbacks=int(numbers[FALLBACKS]),
        residual_max=float(numbers[RESIDUAL]),
        printed_residual_max=float(numbers[PRINTED_RESIDUAL]),
        penetration_max=float(numbers[PENETRATION]),
        joint_gap_max=float(numbers[GAP_MAX]),
        joint_twist_max=float(numbers[TWIST_MAX]),
        contacts=int(numbers[CONTACTS]),
        joint_torque=applied / dt,
    )
    if link := int(numbers[FAILED_LINK]):
        report.failure = divergence(link, numbers[FAILED_VALUE], dt, report.steps)
    return report
