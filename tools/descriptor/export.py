"""Write a trained network as the package reads it: a line that says what it is, then ONNX with halves."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import Final

import torch
from network import FEATURES, INPUTS, Network

FORMAT: Final = "anchorpose-learnt-descriptor"
SCRIPT: Final = ("network.py", "people.py", "scenes.py", "sensors.py", "../train_descriptor.py")
SMALL: Final = 64  # arrays up to this size stay as they are


def export(network: Network, centres: torch.Tensor, images: int, path: Path) -> None:
    """Write ``path``; images: how many the network was trained on."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    file = io.BytesIO()
    torch.onnx.export(
        network.eval().cpu(),
        (torch.rand(1, INPUTS, 64, 96),),
        file,
        dynamo=False,
        training=torch.onnx.TrainingMode.PRESERVE,  # normalisation stays apart: training can go on
        input_names=["depth"],
        output_names=["said"],
        dynamic_axes={"depth": {2: "h", 3: "w"}, "said": {2: "h", 3: "w"}},
    )
    model = onnx.load_from_string(file.getvalue())
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
        if values.dtype == "float32" and values.ndim > 1 and values.size > SMALL:
            stored.append(numpy_helper.from_array(values.astype("float16"), f"{tensor.name}_half"))
            casts.append(helper.make_node("Cast", [f"{tensor.name}_half"], [tensor.name], to=TensorProto.FLOAT))
        else:
            stored.append(tensor)
    nodes = [*casts, *model.graph.node]
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(stored)
    model.graph.node.extend(nodes)
    onnx.checker.check_model(model)
    content = model.SerializeToString(deterministic=True)
    network_sha256 = hashlib.sha256(content).hexdigest()
    head = {"format": FORMAT, "images": images, "script_sha256": script_hash(), "network_sha256": network_sha256}
    path.write_bytes(json.dumps(head).encode() + b"\n" + content)


def stored_state(path: Path) -> tuple[dict[str, torch.Tensor], int]:
    """The network's state in an exported file, and how many images it was trained on: training goes on from there."""
    import onnx
    from onnx import numpy_helper

    line, _, content = path.read_bytes().partition(b"\n")
    graph = onnx.load_from_string(content).graph
    found = {tensor.name.removesuffix("_half"): numpy_helper.to_array(tensor) for tensor in graph.initializer}
    network = Network(len(found["own_centres"]))
    state = network.state_dict()
    found["places.weight"] = found["own_slope"].reshape(state["places.weight"].shape)
    found["places.bias"] = found["own_base"].reshape(-1)
    for name, values in state.items():
        if name in found:
            values.copy_(torch.as_tensor(found[name].astype("float32")))
        elif not name.endswith("num_batches_tracked"):
            raise ValueError(f"{path}: has no {name}; it is of another network")
    return state, int(json.loads(line)["images"])


def script_hash() -> str:
    """SHA-256 of all files that decide what is learnt."""
    here = Path(__file__).resolve().parent
    return hashlib.sha256(b"".join((here / name).read_bytes() for name in SCRIPT)).hexdigest()
