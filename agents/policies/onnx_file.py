"""A policy as an ONNX file, for a vehicle's computer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.execution.files import write_bytes

ONNX_OPSET, ONNX_IR = 17, 9
"""Versions that runtimes of 2023 and later read."""


def write_onnx(policy: LearnedPolicy, path: Path) -> None:
    """Write the policy for a vehicle's computer: one input ``observations`` (N, O), one output ``actions`` (N, A), both
    float32, normalisation and bounds included.

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
    sizes = policy.sizes
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observations", TensorProto.FLOAT, ["N", sizes[0]])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, ["N", sizes[-1]])],
        [numpy_helper.from_array(np.ascontiguousarray(array), name) for name, array in constants.items()],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", ONNX_OPSET)], ir_version=ONNX_IR, producer_name="aoro-gym"
    )
    terms = {name: [span.start, span.stop] for name, span in policy.layout.items()}
    helper.set_model_props(model, {"environment": policy.environment, "observation": json.dumps(terms)})
    onnx.checker.check_model(model, full_check=True)
    write_bytes(path, model.SerializeToString())
