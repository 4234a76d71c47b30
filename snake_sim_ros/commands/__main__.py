# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line as a module, ``python3 -m snake_sim_ros.commands``."""

import sys

from snake_sim_ros.commands.main import main

if __name__ == '__main__':
    sys.exit(main())
