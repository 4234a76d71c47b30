# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records that compiled functions reach by their address, and calls with them."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from snake_sim_ros.dynamics.compilation import COMPILES
from snake_sim_ros.dynamics.records import Block, BoundCall, entry


class Inner(NamedTuple):
    table: Any
    nothing: Any
    cube: Any


class Outer(NamedTuple):
    number: float
    inner: Inner
    is_set: bool
    count: int
    numbers: Any


class Empty(NamedTuple):
    pass


TABLE = np.dtype([('gap', float), ('closed', np.int64)])


def outer(count=3):
    """Return a record with fields of all kinds."""
    inner = Inner(np.zeros(2, TABLE), None, np.arange(24.0).reshape(2, 3, 4))
    return Outer(0.5, inner, True, count, np.arange(5.0))


@entry
def add_all(record, other):
    """Add all fields of a record to the numbers of another one; return how many it has."""
    inner = record.inner
    inner.table['gap'][1] = record.number
    inner.table[0]['closed'] = record.count
    if inner.nothing is None and record.is_set:
        for i in range(inner.cube.shape[0]):
            for j in range(inner.cube.shape[1]):
                for k in range(inner.cube.shape[2]):
                    other.numbers[0] += inner.cube[i, j, k]
    last = record.numbers[1:]
    for x in last:
        other.numbers[1] += x
    return inner.cube.size + len(last)


def test_compiled_code_reads_every_kind_of_field():
    record, other = outer(), outer(-7)
    call = BoundCall(add_all, Block(record), Block(other))
    assert call() == 24 + 4
    assert other.numbers.tolist() == [24 * 23 / 2, 1.0 + 10.0, 2.0, 3.0, 4.0]
    assert record.inner.table.tolist() == [(0.0, 3), (0.5, 0)]
    assert record.numbers.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_call_can_be_made_again_on_what_has_changed():
    record = outer()
    call = BoundCall(add_all, Block(record), Block(record))
    call()
    record.inner.cube[:] = 1.0
    record.numbers[:] = 0.0
    call()
    assert record.numbers[0] == 24.0


@entry
def double(record):
    """Double the numbers of a record."""
    for k in range(len(record.numbers)):
        record.numbers[k] *= 2.0


def test_nothing_that_is_returned_is_zero():
    record = outer()
    assert BoundCall(double, Block(record))() == 0
    assert record.numbers.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_the_memory_of_arrays_is_shared_and_kept():
    record = outer()
    block = Block(record)
    assert block.record is record
    assert Block(Empty()).words == b''


def test_arrays_must_be_contiguous():
    record = outer()._replace(numbers=np.zeros(8)[::2])
    with pytest.raises(TypeError, match=r'C-contiguous, got strides \(16,\)'):
        Block(record)


@pytest.mark.skipif(not COMPILES, reason='nothing is compiled')
def test_a_type_is_that_of_the_fields_and_of_their_places():
    from snake_sim_ros.dynamics.lowered_records import type_of  # it imports the compiler

    kinds = [Block(outer(count)).kind for count in (1, 2)]
    assert kinds[0] == kinds[1]
    wide = outer()._replace(numbers=np.zeros((2, 2)))
    whole = outer()._replace(number=1)
    assert len({str(type_of(Block(record).kind)) for record in (outer(), wide, whole)}) == 3
    kind = type_of(kinds[0])
    assert kind.places == [0, 1, 1 + 2 + 4, 1 + 6 + 1, 1 + 6 + 2]
    assert kind.size == 9 + 2


class Pair(NamedTuple):
    first: float
    rest: Any


@entry
def weighted(pair: Pair, is_negative: bool, table: Any, nothing: None, count: int) -> float:
    """Return a sum in which each argument has a weight of its own."""
    total = pair.first + 10.0 * pair.rest[0] + 100.0 * pair.rest[1].sum() + 1000.0 * count
    total += 1e4 * table[1, 0] if nothing is None else 0.0
    return -total if is_negative else total


@entry
def is_large(x: float) -> bool:
    """Return whether a number is above one."""
    return x > 1.0


def test_python_calls_machine_code_with_arguments_of_all_kinds():
    table = np.array([[0.0, 1.0], [2.0, 3.0]])
    pair = Pair(4.0, (5.0, np.array([1.0, 2.0])))
    assert weighted(pair, False, table, None, 7) == 4.0 + 50.0 + 300.0 + 7000.0 + 2e4
    assert weighted(pair, True, table[1:].repeat(2, axis=0), None, 0) == -(354.0 + 2e4)
    assert is_large(2.0) is True and is_large(0.5) is False
    assert double(outer()) is None


@pytest.mark.skipif(not COMPILES, reason='nothing is compiled')
def test_an_error_in_machine_code_is_an_error():
    @entry
    def fails(x: float) -> float:
        if x > 0.0:
            raise ValueError
        return x

    assert fails(-1.0) == -1.0
    with pytest.raises(RuntimeError, match='fails raised an error, status 1'):
        fails(1.0)
