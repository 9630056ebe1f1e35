"""The default kernel knows the number of every law; the other one leaves them as the record has them."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false, reportCallIssue=false
from typing import Any

import pytest
import warp as wp

from aoro_gym.machine import Machine
from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.kernels.laws import ChosenLaws, DefaultLaws, with_laws
from aoro_gym.twin.records import LAW_FIELDS, MachineRecord, pack


@wp.kernel(enable_backward=False)
def seen_kernel(laws: Any, machines: wp.array(dtype=MachineRecord), seen: wp.array(dtype=MachineRecord)):
    i = wp.tid()
    seen[i] = with_laws(laws, machines[i])


@pytest.mark.parametrize("laws", [DefaultLaws, ChosenLaws], ids=lambda kind: kind.key)
def test_laws_that_a_kernel_sees(machine: Machine, laws: Any) -> None:
    records = pack(machine.with_laws(**{law: options[-1] for law, options in OPTIONS.items()}))
    seen = wp.zeros(1, dtype=MachineRecord, device="cpu")
    wp.launch(seen_kernel, 1, [laws(), wp.array(records, dtype=MachineRecord, device="cpu"), seen], device="cpu")
    record = seen.numpy()
    for law, options in OPTIONS.items():
        section, name = LAW_FIELDS[law].split(".")
        assert record[section][name] == (len(options) - 1 if laws is ChosenLaws else 0), law
