"""Samples that were not used are told by their own rows, of joined records too."""

import numpy as np

from preisach_jax import Record
from preisach_jax.record.blemishes import fault_lines
from preisach_jax.record.joined import joined

TIME = np.arange(99.0)


def spoiled(record, shift=0):
    spikes = np.zeros(len(record), dtype=bool)
    spikes[[5 + shift, 21 + shift]] = True
    return record.masked([("stuck", 30 + shift, 38 + shift)]).without(spikes)


def test_rows_of_one_record_are_counted_from_1_and_those_of_joined_ones_are_their_own():
    stuck, spikes = fault_lines(spoiled(Record.from_arrays(TIME, TIME % 7, TIME % 7)))
    assert stuck.endswith("samples 31-38")
    assert spikes.endswith("samples 6, 22")
    both = joined([Record.from_arrays(TIME, TIME % k, TIME % k, name=f"{k}.csv") for k in (7, 9)])
    stuck, spikes = fault_lines(spoiled(both, shift=99))
    assert stuck.endswith("samples 31-38 of 9.csv")
    assert spikes.endswith("samples 6 of 9.csv, 22 of 9.csv")
