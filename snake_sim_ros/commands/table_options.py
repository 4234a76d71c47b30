"""The option of commands whose CSV files grow row by row."""

import argparse


def add_other_sources(command: argparse.ArgumentParser) -> None:
    """Add the option that lets a file grow with rows of other sources."""
    command.add_argument(
        '--other-sources', action='store_true',
        help='go on with a file whose rows are of other sources; new rows have their own head',
    )  # fmt: skip
