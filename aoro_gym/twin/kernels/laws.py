"""Which laws a kernel is compiled for: the default ones, or those that each machine's record chooses."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportRedeclaration=false
import warp as wp

from aoro_gym.twin.records import MachineRecord


@wp.struct
class DefaultLaws:
    """Says to a kernel that all machines obey the default laws: it is compiled without the others."""

    unused: int


@wp.struct
class ChosenLaws:
    """Says to a kernel that each machine's record has the numbers of its laws."""

    unused: int


@wp.func
def with_laws(laws: DefaultLaws, m: MachineRecord):
    """``m`` with the numbers of the default laws as constants, which the compiler then leaves out."""
    out = m
    out.varies_laws = 0
    out.steering.spool_law = 0
    out.steering.opening_law = 0
    out.steering.orifice_law = 0
    out.steering.flow_force_law = 0
    out.steering.compensator_law = 0
    out.steering.compensator_sensing_law = 0
    out.steering.shock_valve_law = 0
    out.steering.pump_law = 0
    out.steering.load_sensing_line_law = 0
    out.steering.return_line_law = 0
    out.steering.hose_law = 0
    out.oil.gas_law = 0
    out.oil.liquid_law = 0
    out.joint.friction_law = 0
    out.joint.mount_law = 0
    out.tire.swivel_law = 0
    out.tire.slip_law = 0
    out.tire.soft_ground_law = 0
    out.arm_valve.arm_valve_law = 0
    out.driveline.second_gear_law = 0
    return out


@wp.func
def with_laws(laws: ChosenLaws, m: MachineRecord):  # noqa: F811 (an overload)
    """``m`` as it is."""
    out = m
    out.varies_laws = 1
    return out
