"""``modelDescription.xml`` of the exported twin, for FMI 2.0 and 3.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from xml.etree import ElementTree as ET

from aoro_gym.cosimulation.export.source import MAIN_STEP
from aoro_gym.cosimulation.export.units import definitions
from aoro_gym.cosimulation.export.variables import INPUT, OUTPUT, PARAMETER, Variable
from aoro_gym.version import VERSION

IDENTIFIER = "aoro"
"""Name of the binary, without its suffix."""
STEP = 0.01
"""Step [s] that importers use by default: the machine's own logger has 100 Hz."""
STOP = 10.0
"""Time [s] at which importers stop by default."""


def description(version: str, name: str, token: str, listed: Sequence[Variable]) -> bytes:
    """The description as XML.

    Args:
        version: ``"2.0"`` or ``"3.0"``.
        name: Of the machine.
        token: By which importer and binary know that they belong together.
        listed: The variables by number.
    """
    root = _root(version, name, token)
    _units(root, listed)
    categories = ET.SubElement(root, "LogCategories")
    for category in ("logStatusWarning", "logStatusDiscard", "logStatusError"):
        ET.SubElement(categories, "Category", name=category)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=repr(STOP), stepSize=repr(STEP))
    variables = ET.SubElement(root, "ModelVariables")
    for number, one in enumerate(listed):
        (_variable_2 if version == "2.0" else _variable_3)(variables, number, one)
    structure = ET.SubElement(root, "ModelStructure")
    (_structure_2 if version == "2.0" else _structure_3)(structure, listed)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _root(version: str, name: str, token: str) -> ET.Element:
    common = {
        "fmiVersion": version,
        "modelName": name,
        "description": "Digital twin of an articulated forestry machine",
        "version": VERSION,
        "license": "Apache-2.0",
        "generationTool": f"aoro-gym {VERSION}",
        "generationDateAndTime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "variableNamingConvention": "structured",
    }
    states = {"canSerializeFMU{}tate": "true", "canGetAndSetFMU{}tate": "true"}
    if version == "2.0":
        root = ET.Element("fmiModelDescription", {**common, "guid": token, "numberOfEventIndicators": "0"})
        offered = {key.format("s"): value for key, value in states.items()}
    else:
        root = ET.Element("fmiModelDescription", {**common, "instantiationToken": token})
        offered = {key.format("S"): value for key, value in states.items()}
        offered["fixedInternalStepSize"] = repr(MAIN_STEP)
    offered["canHandleVariableCommunicationStepSize"] = "true"
    ET.SubElement(root, "CoSimulation", {"modelIdentifier": IDENTIFIER, **offered})
    return root


def _units(root: ET.Element, listed: Sequence[Variable]) -> None:
    units = ET.SubElement(root, "UnitDefinitions")
    for unit, attributes in definitions(one.unit for one in listed).items():
        ET.SubElement(ET.SubElement(units, "Unit", name=unit), "BaseUnit", attributes)


def _common(number: int, one: Variable) -> dict[str, str]:
    out = {"name": one.name, "valueReference": str(number), "description": one.description, "causality": one.kind}
    if number == 0:
        return {**out, "causality": "independent", "variability": "continuous"}
    if one.kind == PARAMETER:
        return {**out, "variability": "fixed", "initial": "exact"}
    out["variability"] = "discrete" if one.whole else "continuous"
    return out | ({"initial": "calculated"} if one.kind == OUTPUT else {})


def _typed(one: Variable) -> dict[str, str]:
    """Unit, range and start of a variable."""

    def text(value: float) -> str:
        return str(int(value)) if one.whole else repr(float(value))

    out = {} if one.whole else {"unit": one.unit}
    if one.suggested is not None and all(math.isfinite(limit) for limit in one.suggested):
        out |= {"min": text(one.suggested[0]), "max": text(one.suggested[1])}
    return out if one.kind == OUTPUT else out | {"start": text(one.start)}


def _variable_2(parent: ET.Element, number: int, one: Variable) -> None:
    scalar = ET.SubElement(parent, "ScalarVariable", _common(number, one))
    ET.SubElement(scalar, "Integer" if one.whole else "Real", _typed(one))


def _variable_3(parent: ET.Element, number: int, one: Variable) -> None:
    common = _common(number, one)
    if one.kind == INPUT:
        common["initial"] = "exact"
    ET.SubElement(parent, "Int32" if one.whole else "Float64", {**common, **_typed(one)})


def _structure_2(structure: ET.Element, listed: Sequence[Variable]) -> None:
    """Outputs by their index from 1; at a point of communication none of them depends on an input of then."""
    numbers = [str(index) for index, one in enumerate(listed, 1) if one.kind == OUTPUT and index > 1]
    outputs = ET.SubElement(structure, "Outputs")
    for number in numbers:
        ET.SubElement(outputs, "Unknown", index=number, dependencies="")
    initial = ET.SubElement(structure, "InitialUnknowns")
    for number in numbers:
        ET.SubElement(initial, "Unknown", index=number)


def _structure_3(structure: ET.Element, listed: Sequence[Variable]) -> None:
    numbers = [str(index) for index, one in enumerate(listed) if one.kind == OUTPUT and index > 0]
    for number in numbers:
        ET.SubElement(structure, "Output", valueReference=number, dependencies="")
    for number in numbers:
        ET.SubElement(structure, "InitialUnknown", valueReference=number)
