"""Tables in Markdown of the parts `agreement` and `soak` of the bench."""

from collections.abc import Sequence

from snake_sim_ros.comparison.bench_rows import Row


def agreement_table(rows: Sequence[Row]) -> str:
    """Return a table of the distances of other solvers from the path of `newton`."""
    lines = ['| case | solver | stops at | difference of paths | steps | unconverged |',
             '|---|---|---|---|---|---|']  # fmt: skip
    for row in rows:
        if row.part == 'agreement':
            setting, _, unit = row.setting.partition(' in ')
            cells = [
                f'`{row.case}`',
                f'`{row.method}`',
                f'`{setting}` {row.tolerance:g} {unit}',
                f'{row.path_difference:.1e}',
                f'{row.steps or 0}',
                f'{row.unconverged or 0}',
            ]
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def soak_table(rows: Sequence[Row]) -> str:
    """Return a table of penetration, memory and unconverged steps in very long runs."""
    lines = ['| scene | level | steps | unconverged | penetration at the end [m] | largest [m] '
             '| memory, begin to end [MB] | wall time [s] |',
             '|---|---|---|---|---|---|---|---|']  # fmt: skip
    for row in rows:
        if row.part == 'soak':
            memory = [
                'unknown' if size is None else f'{size / 1e6:.1f}'
                for size in (row.memory_begin, row.memory_end)
            ]
            cells = [
                f'`{row.case}`',
                row.level,
                f'{row.steps or 0}',
                f'{row.unconverged or 0}',
                f'{row.penetration_end:.1e}',
                f'{row.penetration_max:.1e}',
                ' to '.join(memory),
                f'{row.seconds:.0f}',
            ]
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'
