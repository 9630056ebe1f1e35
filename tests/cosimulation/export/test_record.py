"""The record that C derives from parameters, against the one that Python packs."""

import ctypes
from typing import Any

import numpy as np
import pytest

from aoro_gym.cosimulation.export.build import export_twin, generate
from aoro_gym.cosimulation.export.compiler import link
from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import DECLARATIONS, InvalidMachine
from aoro_gym.terrains import Plane
from aoro_gym.twin.hydraulic_step import largest_hydraulic_step
from aoro_gym.twin.records import MachineRecord, pack

KEYS = [key for key in DECLARATIONS if not key.startswith(PAYLOAD)]
"""Parameters of exported twins."""
LAYOUT: Any = MachineRecord.numpy_dtype()
PROBE = """
#include "aoro.c"
AORO_API const char *probe(const double *parameters, void *record) { return derive(parameters, record); }
AORO_API double start(int variable) { return variables[variable].start; }
"""


@pytest.fixture(scope="module")
def probe(shipped, tmp_path_factory):
    """The function ``derive`` of C, and the numbers of its parameters by key."""
    folder = tmp_path_factory.mktemp("probe")
    made = generate(folder, shipped, Plane())
    (folder / "probe.c").write_text(PROBE)
    link([folder / "probe.c"], [made.kernels.object_file], ["probe", "start"], folder / "probe.so")
    library = ctypes.CDLL(str(folder / "probe.so"))
    library.probe.restype = ctypes.c_char_p
    library.start.restype = ctypes.c_double
    return library, [one for one in made.listed if one.kind == "parameter"]


def derived(probe, machine) -> tuple[Any, Any]:
    """Record of C, or the reason for which there is none."""
    library, parameters = probe
    values = [machine.entries[one.name].value if one.name in DECLARATIONS else one.start for one in parameters]
    record = np.zeros(1, dtype=np.dtype(LAYOUT))
    reason = library.probe((ctypes.c_double * len(values))(*values), ctypes.c_void_p(record.ctypes.data))
    return (record, None) if reason is None else (None, reason.decode())


def test_start_values_are_the_machines(probe, shipped):
    record, reason = derived(probe, shipped)
    assert reason is None
    assert record.tobytes() == pack(shipped).tobytes()


@pytest.mark.parametrize("reach", [0.02, 0.3, 1.0])
def test_any_parameters_give_the_record_or_the_refusal_of_python(reach, probe, shipped):
    """Every parameter is drawn, by a factor of e^(+-reach): the farther, the more of them are no machine."""
    rng = np.random.default_rng(int(100 * reach))
    valid = 0
    for _ in range(25):
        factors = dict(zip(KEYS, np.exp(rng.uniform(-reach, reach, len(KEYS))), strict=True))
        values = {key: shipped.entries[key].value * factor for key, factor in factors.items()}
        for key in KEYS:
            if not DECLARATIONS[key].admits(
                values[key] * shipped.entries[key].si / (shipped.entries[key].value or 1.0)
            ):
                values[key] = shipped.entries[key].value
        expected = None
        try:
            machine = shipped.set(values, check_ranges=False)
        except InvalidMachine as error:
            expected = error.sentence
            machine = shipped.variant(0)
            entries = {
                key: type(one)(key, values.get(key, one.value), one.unit, one.range, "", one.role)
                for key, one in shipped.entries.items()
            }
            object.__setattr__(machine, "entries", entries)
        record, reason = derived(probe, machine)
        if expected is not None:
            assert reason is not None and reason.endswith(f": {expected}")
        elif largest_hydraulic_step(machine)[0] < 1e-3 / 30:
            assert reason is not None and "unstable" in reason
        else:
            assert reason is None
            assert record.tobytes() == pack(machine).tobytes()
            valid += 1
    if reach < 0.3:
        assert valid > 8


@pytest.mark.parametrize("key", KEYS[::7])
def test_one_parameter_alone_changes_the_record_as_in_python(key, probe, shipped):
    entry = shipped.entries[key]
    machine = shipped.set({key: 1.01 * entry.value if entry.value else 0.5 * entry.range[1]}, check_ranges=False)
    record, reason = derived(probe, machine)
    assert reason is None
    assert record.tobytes() == pack(machine).tobytes()


def test_a_load_is_refused(shipped, tmp_path):
    with pytest.raises(
        ValueError, match=r"carries a load, which exported twins know nothing of; .* --set payload\.count=0"
    ):
        export_twin("c", tmp_path, machine=shipped.set({"payload.count": 10.0}))
