"""Units of FMI 2.0 and 3.0 in an importer, FMPy: described as the standard wants it, equal to the Python twin to the bit."""

import zipfile
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from aoro_gym.cosimulation.export.build import export_twin
from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import DECLARATIONS
from aoro_gym.recording.commands import COMMAND_BOUNDS
from aoro_gym.terrains import Plane
from tests.cosimulation.export.library import assert_same_bits, listed_for, outputs, portable_twin, run_twin

FORMATS = ("fmi2", "fmi3")
SLAVES = {"fmi2": FMU2Slave, "fmi3": FMU3Slave}


def described(unit) -> Any:
    """The description as the importer reads it."""
    return fmpy.read_model_description(unit)


class Instance:
    """An instance in an importer, with the same calls for both versions."""

    def __init__(self, format, folder, name="one"):
        self.two = format == "fmi2"
        self.description = described(folder)
        self.numbers = {one.name: one.valueReference for one in self.description.modelVariables}
        self.said = []
        self.slave = SLAVES[format](
            guid=self.description.guid if self.two else self.description.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.slave.instantiate(**({"callbacks": self._callbacks()} if self.two else {"logMessage": self._log}))

    def _log(self, environment, status, category, message):
        self.said.append(message.decode())

    def _callbacks(self):
        def log(environment, name, status, category, message):
            self.said.append(message.decode())

        memory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
        return type(defaultCallbacks)(fmi2CallbackLoggerTYPE(log), *memory)

    def begin(self, start=0.0, **values):
        self.set(**values)
        if self.two:
            self.slave.setupExperiment(startTime=start)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=start)
        self.slave.exitInitializationMode()
        return self

    def set(self, **values):
        for name, value in values.items():
            number = [self.numbers[name.replace("__", ".")]]
            if name == "gear":
                (self.slave.setInteger if self.two else self.slave.setInt32)(number, [int(value)])
            else:
                (self.slave.setReal if self.two else self.slave.setFloat64)(number, [value])

    def get(self, *names):
        read = self.slave.getReal if self.two else self.slave.getFloat64
        return np.array(read([self.numbers[name] for name in names]))

    def step(self, point, size):
        self.slave.doStep(currentCommunicationPoint=point, communicationStepSize=size)

    def state(self):
        slave = self.slave
        held = slave.getFMUState()
        content = slave.serializeFMUState(held)
        slave.freeFMUState(held)
        return bytes(content)

    def restore(self, content):
        held = self.slave.deserializeFMUState(content)
        self.slave.setFMUState(held)
        self.slave.freeFMUState(held)


@pytest.fixture(scope="module", params=FORMATS)
def format(request):
    return request.param


@pytest.fixture(scope="module")
def folder(format, unit, tmp_path_factory):
    """The unit, unpacked."""
    return fmpy.extract(unit(format), tmp_path_factory.mktemp(format))


def test_the_standards_schema_and_structure_are_kept(format, unit):
    fmpy.read_model_description(unit(format), validate=True, validate_model_structure=True)


@pytest.mark.slow
def test_the_importers_validation_finds_nothing(format, unit):
    """With the grammar of names, which takes 10 s."""
    assert validate_fmu(str(unit(format))) == []


def test_variables_are_commands_outputs_and_every_parameter(format, unit, shipped):
    description = described(unit(format))
    found = {one.name: one for one in description.modelVariables}
    assert [one.name for one in description.modelVariables if one.causality == "input"] == list(COMMAND_BOUNDS)
    named = {one.name for one in description.modelVariables if one.causality == "parameter"}
    assert {key for key in DECLARATIONS if not key.startswith(PAYLOAD)} <= named
    lag = found["steering.valve.spool_time_constant"]
    entry = shipped.entries[lag.name]
    assert (lag.unit, float(lag.start), float(lag.min), float(lag.max)) == (entry.unit, entry.value, *entry.range)
    bar = next(one for one in description.unitDefinitions if one.name == "bar").baseUnit
    assert (bar.kg, bar.m, bar.s, bar.factor) == (1, -1, -2, 1e5)
    assert description.coSimulation.canHandleVariableCommunicationStepSize


def test_an_importer_gets_the_bits_of_the_python_twin(format, unit, shipped):
    """A turn while driving off in second gear, with a machine changed by parameters, by the importer's own loop."""
    listed = listed_for(shipped, Plane())
    schedule = {0.0: (0.0, 0.0, 1), 0.05: (1.0, 0.5, 1), 0.6: (-0.4, 0.5, 2)}
    table = np.array(
        [(time, *row) for time, row in schedule.items()],
        dtype=[("time", float), ("steering_signal", float), ("drive_signal", float), ("gear", np.int32)],
    )
    # an importer interpolates inputs between rows: hold each until just before the next
    held = np.array([(0.05 - 1e-9, *schedule[0.0]), (0.6 - 1e-9, *schedule[0.05])], dtype=table.dtype)
    key, value = "steering.valve.spool_time_constant", 3.0 * shipped.entries["steering.valve.spool_time_constant"].value
    result = fmpy.simulate_fmu(
        str(unit(format)),
        stop_time=1.2,
        output_interval=0.01,
        step_size=0.01,
        input=np.sort(np.concatenate([table, held]), order="time"),
        start_values={key: value, "initial.joint_angle": -0.3},
        output=outputs(listed),
    )
    machine = shipped.set({key: value}, check_ranges=False)

    def told(step) -> dict[str, float]:
        row = schedule.get(round(0.01 * step, 3))
        return {} if row is None else dict(zip(("steering_signal", "drive_signal", "gear"), row, strict=True))

    expected = run_twin(portable_twin(machine), told, 120, joint_angle=-0.3)
    found = np.stack([result[name] for name in outputs(listed)], axis=1).astype(np.float32)
    assert_same_bits(found[1:], expected)


def test_instances_begin_late_and_do_not_disturb_each_other(format, folder):
    one, other = Instance(format, folder, "one"), Instance(format, folder, "other")
    one.begin(start=5.0, steering_signal=1.0)
    other.begin()
    for step in range(20):
        one.step(5.0 + 0.01 * step, 0.01)
        other.step(0.01 * step, 0.01)
    assert one.get("joint_angle")[0] > 0.01 > abs(other.get("joint_angle")[0])
    for instance in (one, other):
        instance.slave.terminate()
        instance.slave.freeInstance()


def test_steps_are_whole_milliseconds_in_sequence(format, folder):
    instance = Instance(format, folder).begin()
    for point, size in ((0.0, 0.0005), (0.0, 0.0), (0.0, -0.01), (0.0, float("nan")), (0.5, 0.01)):
        with pytest.raises(FMICallException) as error:
            instance.step(point, size)
        assert error.value.status == 2, "discarded: another step may follow"
    before = instance.get("position_z")
    instance.step(0.0, 0.001)
    instance.step(0.001, 0.043)
    assert instance.get("position_z") != before
    instance.slave.freeInstance()


def test_states_are_kept_written_and_restored(format, folder):
    instance = Instance(format, folder).begin(steering_signal=1.0)
    instance.step(0.0, 0.1)
    state = instance.state()
    instance.step(0.1, 0.2)
    expected = instance.get("joint_angle", "pressure_a", "wheel_load_fl")
    instance.slave.reset()
    instance.restore(state)
    instance.step(0.1, 0.2)
    np.testing.assert_array_equal(instance.get("joint_angle", "pressure_a", "wheel_load_fl"), expected)
    other = Instance(format, folder, "other")
    other.restore(state)
    other.step(0.1, 0.2)
    np.testing.assert_array_equal(other.get("joint_angle", "pressure_a", "wheel_load_fl"), expected)
    with pytest.raises(FMICallException):
        other.restore(state[:-8])
    for one in (instance, other):
        one.slave.freeInstance()


def test_a_non_finite_state_is_an_error_until_a_reset(format, folder):
    instance = Instance(format, folder).begin(steering_signal=1.0)
    instance.step(0.0, 0.1)
    rate = np.float32(instance.get("joint_rate")[0]).tobytes()
    state = instance.state()
    instance.restore(state.replace(rate, np.float32(np.nan).tobytes(), 1))
    with pytest.raises(FMICallException) as error:
        instance.step(0.1, 0.01)
    assert error.value.status == 3
    with pytest.raises(FMICallException):
        instance.step(0.1, 0.01)
    instance.slave.reset()
    instance.begin()
    instance.step(0.0, 0.01)
    instance.slave.terminate()
    instance.slave.freeInstance()


def test_reasons_are_logged(folder, format):
    instance = Instance(format, folder).begin()
    for call, reason in (
        (
            lambda: instance.step(0.0, 0.0005),
            "the step size is 0.0005 s, but must be a positive whole multiple of 0.001 s",
        ),
        (lambda: instance.set(steering_signal=2.0), "steering_signal is 2, but must be at least -1 and at most 1"),
        (
            lambda: instance.set(oil__gas_fraction=0.01),
            "oil.gas_fraction is a parameter, fixed once the machine stands",
        ),
        (lambda: instance.slave.enterInitializationMode(), "must not be called while the instance is in step mode"),
    ):
        with pytest.raises(FMICallException):
            call()
        assert reason in instance.said[-1]
    instance.slave.freeInstance()


def test_a_machine_that_cannot_be_is_refused_at_initialisation(format, folder):
    instance = Instance(format, folder)
    with pytest.raises(FMICallException) as error:
        instance.begin(steering__cylinder__rod=300.0)
    assert error.value.status == 3
    instance.slave.reset()
    instance.begin()
    instance.slave.freeInstance()


def test_a_unit_is_for_its_own_description_alone(format, folder):
    with pytest.raises(Exception, match="nstantiate"):
        description = described(folder)
        SLAVES[format](
            guid="{0}", unzipDirectory=folder, modelIdentifier=description.coSimulation.modelIdentifier
        ).instantiate()


@pytest.mark.slow
def test_equal_machines_make_equal_binaries(format, unit, shipped, tmp_path):
    again = tmp_path / "again.fmu"
    export_twin(format, again, machine=shipped)
    with zipfile.ZipFile(unit(format)) as first, zipfile.ZipFile(again) as second:
        assert first.namelist() == second.namelist()
        for name in first.namelist():
            if name != "modelDescription.xml":  # it tells when it was made
                assert first.read(name) == second.read(name)
