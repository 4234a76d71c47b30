# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The order in which a node takes its messages, when reading one takes longer than a period."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

# What takes long, and what takes its result (by calling the argument, which may raise).
Prepare = Callable[[], Any]
Apply = Callable[[Prepare], object]


class Turns:
    """
    Prepares small messages at once and large ones in a thread beside the node.

    Messages that come while a large one is being prepared wait for it, the last of each topic. So
    do those that come before `open` is called.

    Attributes
    ----------
    is_open : bool
        Whether `open` was called.

    """

    def __init__(self) -> None:
        self.is_open = False
        self._beside: ThreadPoolExecutor | None = None
        self._work: tuple[Future[Any], Apply] | None = None
        self._waiting: dict[str, tuple[Prepare, Apply, bool]] = {}

    def take(self, topic: str, prepare: Prepare, apply: Apply, *, large: bool = False) -> None:
        """
        Take a message, now or when it is its turn.

        Parameters
        ----------
        topic : str
        prepare : callable
            What may take long; of a large message it runs in another thread.
        apply : callable
            Called in the thread of the node with a function that returns what was prepared.
        large : bool

        """
        if self._work or not self.is_open:
            self._waiting.pop(topic, None)  # It goes to the end.
            self._waiting[topic] = prepare, apply, large
        elif large:
            if self._beside is None:
                self._beside = ThreadPoolExecutor(1)
            self._work = self._beside.submit(prepare), apply
        else:
            apply(prepare)

    def finish(self, *, wait: bool = False) -> None:
        """Apply what is prepared by now, or wait for all of it."""
        while self._work and (wait or self._work[0].done()):
            (future, apply), self._work = self._work, None
            apply(future.result)
            self._take_waiting()

    def open(self) -> None:
        """Take messages from now on, and those that came before."""
        self.is_open = True
        self._take_waiting()

    def _take_waiting(self) -> None:
        waiting, self._waiting = self._waiting, {}
        for topic, (prepare, then, large) in waiting.items():
            self.take(topic, prepare, then, large=large)

    def forget(self) -> None:
        """Drop what has not been applied."""
        self._work = None
        self._waiting.clear()
