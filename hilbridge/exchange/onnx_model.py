"""A bundle's network as an ONNX file, for other programs: raw features in, logits out, of one whole window.

Standardising, masking and pooling are in the graph. Temperatures, maps, thresholds and the gate are not: they stand in the
metadata as text, and what acts on logits alone is no hilbridge.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import needs_extra
from hilbridge.features.layout import LAYOUT_HASH, MODALITY_OF, D
from hilbridge.files import write_whole
from hilbridge.intent.bundle import Bundle
from hilbridge.intent.gru import POOL_EPSILON
from hilbridge.intent.standardise import Z_LIMIT

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto

OPSET, IR_VERSION = 17, 8  # of 2022: older programs read it too


def export_onnx(bundle: Bundle, path: Path) -> Path:
    """Write it, whole or not at all. Raises InputError without the extra `onnx`."""
    return write_whole(path, onnx_model(bundle).SerializeToString())


def onnx_model(bundle: Bundle) -> ModelProto:
    """values (T, D) float, valid (T, 3) bool -> logits (K,)."""
    with needs_extra("onnx"):
        import onnx
        from onnx import TensorProto, helper, numpy_helper

    steps, verbs = bundle.window_steps, len(bundle.vocabulary)
    graph = helper.make_graph(
        _nodes(bundle.weights.hidden_size),
        "hilbridge",
        [
            helper.make_tensor_value_info("values", TensorProto.FLOAT, [steps, D]),
            helper.make_tensor_value_info("valid", TensorProto.BOOL, [steps, 3]),
        ],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [verbs])],
        [numpy_helper.from_array(value, name) for name, value in _constants(bundle).items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    model.producer_name = "hilbridge"
    helper.set_model_props(model, _said(bundle))
    onnx.checker.check_model(model)
    return model


def _nodes(hidden: int) -> list[NodeProto]:
    from onnx import helper

    def node(kind: str, inputs: str, output: str, **attributes: Any) -> NodeProto:
        return helper.make_node(kind, inputs.split(), output.split(), **attributes)

    return [
        # z-scores within their limit, 0 for what is masked
        node("Sub", "values mean", "centred"),
        node("Div", "centred std", "scaled"),
        node("Clip", "scaled lowest highest", "limited"),
        node("Gather", "valid modality_of", "seen", axis=1),
        node("Where", "seen limited zero", "x"),
        # FC -> GRU
        node("Gemm", "x fc_weight fc_bias", "projected", transB=1),
        node("Relu", "projected", "inner"),
        node("Unsqueeze", "inner one", "sequence"),
        node("GRU", "sequence input_weight hidden_weight bias", "states", hidden_size=hidden, linear_before_reset=1),
        node("Squeeze", "states one_two", "hidden"),
        # mean over steps of which anything was valid -> linear
        node("Cast", "valid", "flags", to=1),
        node("ReduceMax", "flags", "usable", axes=[1], keepdims=1),
        node("Mul", "hidden usable", "kept"),
        node("ReduceSum", "kept zeroth", "sum", keepdims=0),
        node("ReduceSum", "usable zeroth", "count", keepdims=0),
        node("Add", "count epsilon", "divisor"),
        node("Div", "sum divisor", "pooled"),
        node("MatMul", "head_weight pooled", "product"),
        node("Add", "product head_bias", "logits"),
    ]


def _constants(bundle: Bundle) -> dict[str, NDArray[Any]]:
    weights = bundle.weights
    return {
        "mean": bundle.mean,
        "std": bundle.std,
        "lowest": np.array(-Z_LIMIT, dtype=np.float32),
        "highest": np.array(Z_LIMIT, dtype=np.float32),
        "zero": np.array(0.0, dtype=np.float32),
        "epsilon": np.array(POOL_EPSILON, dtype=np.float32),
        "modality_of": np.asarray(MODALITY_OF, dtype=np.int64),
        "one": np.array([1]),
        "one_two": np.array([1, 2]),
        "zeroth": np.array([0]),
        "fc_weight": weights.fc_weight,
        "fc_bias": weights.fc_bias,
        "input_weight": _onnx_order(weights.input_weight)[None],
        "hidden_weight": _onnx_order(weights.hidden_weight)[None],
        "bias": np.concatenate([_onnx_order(weights.input_bias), _onnx_order(weights.hidden_bias)])[None],
        "head_weight": weights.head_weight,
        "head_bias": weights.head_bias,
    }


def _onnx_order(blocks: NDArray[np.float32]) -> NDArray[np.float32]:
    """Torch has reset, update, new; ONNX has update, reset, new."""
    reset, update, new = np.split(blocks, 3)
    return np.concatenate([update, reset, new])


def _said(bundle: Bundle) -> dict[str, str]:
    return {
        "hilbridge.bundle_id": f"{bundle.bundle_id:#06x}",
        "hilbridge.layout_hash": LAYOUT_HASH,
        "hilbridge.verbs": json.dumps(bundle.vocabulary.names),
        "hilbridge.assisted": json.dumps(bundle.vocabulary.assisted),
        "hilbridge.temperatures": json.dumps({str(mask): value for mask, value in sorted(bundle.temperatures.items())}),
        "hilbridge.note": "logits only: no calibration, no gate, no certificate; nothing may act on them alone",
    }
