"""A policy as an ONNX file, for a vehicle's computer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.policies.memory import GatedMemory
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.execution.files import write_bytes

ONNX_OPSET, ONNX_IR = 17, 9
"""Versions that runtimes of 2023 and later read."""


def write_onnx(policy: LearnedPolicy, path: Path) -> None:
    """Write the policy for a vehicle's computer: one input ``observations`` (N, O), one output ``actions`` (N, A), both
    float32, normalisation and bounds included. One with a memory of U units also takes its ``state`` (N, U), zeros where an
    episode begins, and gives ``next_state``.

    Raises ValueError if onnx is missing.
    """
    try:
        import onnx  # pyright: ignore[reportMissingImports]
        from onnx import TensorProto, helper, numpy_helper  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(f"an ONNX file needs {error.name}: pip install 'aoro-gym[onnx]'") from error
    constants: dict[str, NDArray[Any]] = {"low": policy.low, "high": policy.high}
    nodes: list[Any] = []
    value = "observations"

    def add(operator: str, *others: str, **attributes: Any) -> None:
        nonlocal value
        inputs, value = [value, *others], f"value{len(nodes)}"
        nodes.append(helper.make_node(operator, inputs, [value], **attributes))

    if policy.normalisation is not None:
        one = policy.normalisation
        constants |= {"mean": one.mean, "deviation": np.sqrt(one.variance + one.epsilon)}
        constants |= {"least": np.array(-one.clip), "most": np.array(one.clip)}
        add("Cast", to=TensorProto.DOUBLE)
        add("Sub", "mean")
        add("Div", "deviation")
        add("Clip", "least", "most")
        add("Cast", to=TensorProto.FLOAT)
    states: list[Any] = []
    if policy.memory is not None:
        states = [("state", policy.memory.sizes[2]), ("next_state", policy.memory.sizes[2])]
        constants |= _add_memory(policy.memory, value, nodes)
        value = "remembered"
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        constants |= {f"weight{k}": weight, f"bias{k}": bias}
        add("Gemm", f"weight{k}", f"bias{k}", transB=1)
        if k < len(policy.weights) - 1:
            add({"tanh": "Tanh", "relu": "Relu"}[policy.activation])
    if policy.squashed:
        constants |= {"half_span": 0.5 * (policy.high - policy.low), "middle": 0.5 * (policy.high + policy.low)}
        add("Tanh")
        add("Mul", "half_span")
        add("Add", "middle")
    # Clip takes scalars only, and every action has its own bounds
    add("Max", "low")
    add("Min", "high")
    nodes[-1].output[0] = "actions"
    named = [("observations", policy.observed), *states[:1]], [("actions", policy.sizes[-1]), *states[1:]]
    inputs, outputs = (
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["N", size]) for name, size in values]
        for values in named
    )
    graph = helper.make_graph(
        nodes,
        "policy",
        inputs,
        outputs,
        [numpy_helper.from_array(np.ascontiguousarray(array), name) for name, array in constants.items()],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", ONNX_OPSET)], ir_version=ONNX_IR, producer_name="aoro-gym"
    )
    terms = {name: [span.start, span.stop] for name, span in policy.layout.items()}
    helper.set_model_props(model, {"environment": policy.environment, "observation": json.dumps(terms)})
    onnx.checker.check_model(model, full_check=True)
    write_bytes(path, model.SerializeToString())


def _add_memory(memory: GatedMemory, observations: str, nodes: list[Any]) -> dict[str, NDArray[Any]]:
    """Add to ``nodes`` what makes ``remembered`` and ``next_state`` of ``observations``, normalised, and of ``state``; gives
    their constants."""
    from onnx import helper  # pyright: ignore[reportMissingImports]

    units = memory.sizes[2]
    for operator, inputs, outputs, attributes in (
        ("Gemm", [observations, "memory.encoder_weight", "memory.encoder_bias"], ["encoded_sum"], {"transB": 1}),
        ("Tanh", ["encoded_sum"], ["encoded"], {}),
        ("Gemm", ["encoded", "memory.input_weight", "memory.input_bias"], ["taken"], {"transB": 1}),
        ("Gemm", ["state", "memory.state_weight", "memory.state_bias"], ["kept"], {"transB": 1}),
        ("Split", ["taken", "memory.parts"], ["taken_r", "taken_z", "taken_n"], {"axis": 1}),
        ("Split", ["kept", "memory.parts"], ["kept_r", "kept_z", "kept_n"], {"axis": 1}),
        ("Add", ["taken_r", "kept_r"], ["sum_r"], {}),
        ("Sigmoid", ["sum_r"], ["r"], {}),
        ("Add", ["taken_z", "kept_z"], ["sum_z"], {}),
        ("Sigmoid", ["sum_z"], ["z"], {}),
        ("Mul", ["r", "kept_n"], ["let_in"], {}),
        ("Add", ["taken_n", "let_in"], ["sum_n"], {}),
        ("Tanh", ["sum_n"], ["n"], {}),
        ("Sub", ["state", "n"], ["older"], {}),  # (1 - z) n + z h = n + z (h - n)
        ("Mul", ["z", "older"], ["change"], {}),
        ("Add", ["n", "change"], ["next_state"], {}),
        ("Concat", ["encoded", "next_state"], ["remembered"], {"axis": 1}),
    ):
        nodes.append(helper.make_node(operator, inputs, outputs, **attributes))
    return {**memory.arrays(), "memory.parts": np.array([units] * 3, dtype=np.int64)}
