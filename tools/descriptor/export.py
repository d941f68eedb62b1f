"""Write a trained network as the package reads it: ONNX with halves, and where it came from."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

import torch
from network import FEATURES, INPUTS, Network

FORMAT: Final = "anchorpose learnt descriptor 1"
SCRIPT: Final = ("network.py", "people.py", "scenes.py", "sensors.py", "../train_descriptor.py")
SMALL: Final = 64  # arrays up to this size stay as they are


def export(network: Network, centres: torch.Tensor, images: int, path: Path) -> None:
    """Write ``path``; images: how many the network was trained on."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    torch.onnx.export(
        network.eval().cpu(),
        (torch.rand(1, INPUTS, 64, 96),),
        path,
        dynamo=False,
        input_names=["depth"],
        output_names=["said"],
        dynamic_axes={"depth": {2: "h", 3: "w"}, "said": {2: "h", 3: "w"}},
    )
    model = onnx.load(path)
    places = network.places
    constant = {"slope": places.weight.reshape(-1, 3, FEATURES), "base": places.bias.reshape(-1, 3), "centres": centres}
    for name, values in constant.items():
        tensor = numpy_helper.from_array(values.detach().numpy(), f"own_{name}")
        model.graph.initializer.append(tensor)
        model.graph.node.append(helper.make_node("Identity", [tensor.name], [name]))
        model.graph.output.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, tensor.dims))
    casts, stored = [], []
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if values.dtype == "float32" and values.size > SMALL:
            stored.append(numpy_helper.from_array(values.astype("float16"), f"{tensor.name}_half"))
            casts.append(helper.make_node("Cast", [f"{tensor.name}_half"], [tensor.name], to=TensorProto.FLOAT))
        else:
            stored.append(tensor)
    nodes = [*casts, *model.graph.node]
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(stored)
    model.graph.node.extend(nodes)
    helper.set_model_props(model, {"format": FORMAT, "images": str(images), "script_sha256": script_hash()})
    onnx.checker.check_model(model)
    onnx.save(model, path)


def script_hash() -> str:
    """SHA-256 of all files that decide what is learnt."""
    here = Path(__file__).resolve().parent
    return hashlib.sha256(b"".join((here / name).read_bytes() for name in SCRIPT)).hexdigest()
