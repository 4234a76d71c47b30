"""Where the contact solvers of Newton start in a step: from the history of the last one."""

from snake_sim_ros.dynamics.compilation import merged


@merged
def predict(laws, closed, contacts, history):
    """
    Fill trial velocities and anchors: impulses and velocities continue to change as they did.

    A new contact starts without impulse and with its velocity before the contacts act.

    `laws`, `closed` and `contacts` are those of a `solver.Problem`. The history is that of the
    last step, see `stepping.state`; gamma and selection_center of the contacts are read, trial,
    iterate and anchor filled.
    """
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        for j in range(5):
            contacts.anchor[a, j] = contacts.iterate[a, j] = last[a, j]
            contacts.trial[a, j] = contacts.gamma[a, j]
        P_N = 0.0
        if last[a, 0] > 0.0:
            P_N = last[a, 0] + change[a, 0]
            for k in range(1, 4, 2):
                x, y = velocity[a, k], velocity[a, k + 1]
                next_x, next_y = x + change[a, k], y + change[a, k + 1]
                ahead = x * next_x + y * next_y > 0.0
                contacts.trial[a, k] = next_x if ahead else x
                contacts.trial[a, k + 1] = next_y if ahead else y
        contacts.trial[a, 0] = -laws.compliance * (max(0.0, P_N) - contacts.selection_center[a])


@merged
def remember(closed, contacts, history):
    """
    Fill the history with impulses, velocities and changes of the closed contacts, 0 for open ones.

    The parameters are those of `predict`. The history of the last step is replaced by that of this
    step.
    """
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        contacts.is_closed[a] = 1
        now = contacts.impulse[a, 0] > 0.0
        before = now and last[a, 0] > 0.0
        change[a, 0] = contacts.impulse[a, 0] - last[a, 0] if before else 0.0
        for j in range(1, 5):
            difference = contacts.gamma[a, j] - velocity[a, j]
            change[a, j] = difference if before else 0.0
        for j in range(5):
            last[a, j] = contacts.impulse[a, j] if now else 0.0
            velocity[a, j] = contacts.gamma[a, j] if now else 0.0
    for a in range(len(contacts)):
        if contacts.is_closed[a] == 0 and last[a, 0] > 0.0:
            for j in range(5):
                last[a, j] = velocity[a, j] = change[a, j] = 0.0
        contacts.is_closed[a] = 0
