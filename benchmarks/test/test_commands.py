# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of the laboratory that the pages of the product name, for a moment each."""

from pathlib import Path
import re
import shlex

import pytest

from snake_sim_benchmarks.__main__ import COMMANDS, main

ROOT = Path(__file__).resolve().parents[2]
# What is added to a command so that it ends soon.
SHORTENED = {
    './run bench --quick': 'lateral_undulation --methods newton --dt 0.001 --duration 0.1',
    './run bench --parts throughput': '--quick --duration 0.1',
    './run stability --quick': '--maps spin',
    './run levels': 'lateral_undulation --duration 0.1',
}
# Commands that other tests run, and pages with measurements of hours.
ELSEWHERE = ('pacing', 'chart', 'artefacts', 'figures', 'fuzz', 'soak', 'limits')
LONG = ('speed_accuracy', 'reliability')


def lines():
    """Return the commands of the laboratory on all other pages, each once."""
    pages = [page for page in sorted(ROOT.glob('docs/*.md')) if page.stem not in LONG]
    blocks = re.compile(r'^```sh\n(.*?)^```', re.MULTILINE | re.DOTALL)
    texts = [page.read_text(encoding='utf-8') for page in [ROOT / 'README.md', *pages]]
    found = {
        line for text in texts for block in blocks.findall(text) for line in block.split('\n')
    }
    return sorted(
        line for line in found if line.startswith('./run') and line.split()[1] in COMMANDS
    )


@pytest.mark.parametrize('line', [line for line in lines() if line.split()[1] not in ELSEWHERE])
def test_command(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(f'{line} {SHORTENED[line]}')[1:]) == 0
    assert capsys.readouterr().out


def test_run_knows_the_commands():
    text = (ROOT / 'run').read_text(encoding='utf-8')
    (listed,) = re.findall(
        r'^    ([a-z |]+)\)\n +PYTHONPATH=\$here/benchmarks', text, re.MULTILINE
    )
    assert listed.split(' | ') == list(COMMANDS)
