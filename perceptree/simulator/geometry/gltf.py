"""Export a scene as binary glTF 2.0, which 3D programs can open.

No library is used, because those for the format leave buffers, bounds and padding to the caller.
Specification: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32, Int64, UInt8
from basetree.files.writing import replacing
from perceptree.errors import DatasetError
from perceptree.simulator.geometry.assemble import SceneMesh, assemble
from perceptree.simulator.geometry.prototypes import make_prototypes
from perceptree.simulator.materials.layers import FIRST_GROUND, SIZE_PX, Layer, is_cutout
from perceptree.simulator.materials.textures import Textures, make_textures
from perceptree.simulator.rendering.foreground import with_foreground
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.settings import SimulatorSettings
from perceptree.simulator.vectors import unit

_MAGIC, _VERSION, _JSON_CHUNK, _BINARY_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"
_FLOAT, _UBYTE, _UINT = 5126, 5121, 5125
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_JPEG_QUALITY = 90
_ALPHA_CUTOFF = 0.5


@dataclass(frozen=True)
class Node:
    """A named part of a scene.

    Attributes:
        name: Its name.
        faces: (n,) face numbers.
    """

    name: str
    faces: Int64


def export_scene(path: Path, settings: SimulatorSettings, seed: int) -> tuple[int, int]:
    """Write a scene as binary glTF.

    Args:
        path: File to write.
        settings: Settings of the simulator.
        seed: Seed of the scene.

    Returns:
        Number of trees and number of triangles.

    Raises:
        DatasetError: If the file cannot be written.
    """
    scene = with_foreground(settings, describe_scene(settings, seed))
    mesh = with_one_ground(assemble(scene, make_prototypes()), scene)
    nodes = scene_nodes(mesh, [tree.stem.model.name for tree in scene.trees])
    write_gltf(path, mesh, nodes, make_textures())
    return len(scene.trees), len(mesh.faces)


def with_one_ground(mesh: SceneMesh, scene: Scene) -> SceneMesh:
    """Give the whole ground its main cover, because blending of covers is done by the renderer."""
    layer = mesh.layer.copy()
    layer[: mesh.instance_start[1]] = FIRST_GROUND + int(np.argmax(scene.terrain.cover))
    return replace(mesh, layer=layer)


def scene_nodes(mesh: SceneMesh, tree_names: Sequence[str]) -> list[Node]:
    """Split a scene into nodes: the ground, every tree, and the undergrowth.

    Args:
        mesh: The scene: first the ground, then the trees, then the undergrowth.
        tree_names: Name of each tree.
    """
    first = mesh.tree_start
    nodes = [Node("ground", np.arange(first[0]))]
    for number, name in enumerate(tree_names):
        nodes.append(Node(f"tree_{number + 1:03d}_{name}", np.arange(*first[number : number + 2])))
    nodes.append(Node("undergrowth", np.arange(first[-1], len(mesh.faces))))
    return [node for node in nodes if len(node.faces)]


def write_gltf(path: Path, mesh: SceneMesh, nodes: Sequence[Node], textures: Textures) -> None:
    """Write nodes to a .glb file, in metres with x east, y up and z south.

    Every node has one primitive per texture layer. The textures are embedded in sRGB.

    Args:
        path: File to write.
        mesh: The scene.
        nodes: Its nodes.
        textures: Textures of all layers.

    Raises:
        DatasetError: If the file cannot be written.
    """
    data = gltf_bytes(mesh, nodes, textures)
    try:
        with replacing(path) as file:
            file.write(data)
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise DatasetError(f"{path}: cannot be written ({reason})") from error


def gltf_bytes(mesh: SceneMesh, nodes: Sequence[Node], textures: Textures) -> bytes:
    """Make the content of the file that `write_gltf` writes."""
    layers = np.unique(np.concatenate([mesh.layer[node.faces] for node in nodes]))
    materials = {int(layer): number for number, layer in enumerate(layers)}
    buffer = _Buffer()
    meshes = [
        {"name": node.name, "primitives": _primitives(mesh, node, materials, buffer)}
        for node in nodes
    ]
    images = [_texture_file(textures, Layer(layer)) for layer in layers]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "perceptree scene"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": [{"name": node.name, "mesh": number} for number, node in enumerate(nodes)],
        "meshes": meshes,
        "materials": [_material(Layer(layer), number) for number, layer in enumerate(layers)],
        "textures": [{"source": number, "sampler": 0} for number in range(len(layers))],
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}],
    }
    views, accessors, blocks = buffer.laid_out()
    start = sum(len(block) for block in blocks)
    document["images"] = []
    for layer, (kind, content) in zip(layers, images, strict=True):
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(content)})
        document["images"].append(
            {"bufferView": len(views) - 1, "mimeType": kind, "name": Layer(layer).name.lower()}
        )
        blocks.append(_padded(content, b"\0"))
        start += len(blocks[-1])
    document |= {"bufferViews": views, "accessors": accessors, "buffers": [{"byteLength": start}]}
    return _container(json.dumps(document).encode(), b"".join(blocks))


_KINDS = {
    "POSITION": ("VEC3", _FLOAT, _ARRAY_BUFFER),
    "NORMAL": ("VEC3", _FLOAT, _ARRAY_BUFFER),
    "TEXCOORD_0": ("VEC2", _FLOAT, _ARRAY_BUFFER),
    "COLOR_0": ("VEC4", _UBYTE, _ARRAY_BUFFER),
    "indices": ("SCALAR", _UINT, _ELEMENT_BUFFER),
}


class _Buffer:
    """Collects arrays by attribute, and stores each attribute in one buffer view."""

    def __init__(self) -> None:
        self._accessors: list[dict[str, Any]] = []
        self._blocks: dict[str, list[bytes]] = {kind: [] for kind in _KINDS}
        self._sizes = dict.fromkeys(_KINDS, 0)

    def add(self, kind: str, values: NDArray[Any]) -> int:
        """Append an array (n,) or (n, d), and return the number of its accessor."""
        shape, component, _ = _KINDS[kind]
        accessor = {
            "bufferView": list(_KINDS).index(kind),
            "byteOffset": self._sizes[kind],
            "componentType": component,
            "count": len(values),
            "type": shape,
        }
        if kind == "POSITION":
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        if kind == "COLOR_0":
            accessor["normalized"] = True
        self._accessors.append(accessor)
        self._blocks[kind].append(values.tobytes())
        self._sizes[kind] += values.nbytes
        return len(self._accessors) - 1

    def laid_out(self) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[bytes]]:
        """Return buffer views, accessors, and the blocks of bytes of the buffer."""
        views, blocks, start = [], [], 0
        for kind, (_, _, target) in _KINDS.items():
            block = b"".join(self._blocks[kind])
            views.append(
                {"buffer": 0, "byteOffset": start, "byteLength": len(block), "target": target}
            )
            blocks.append(block)
            start += len(block)
        return views, self._accessors, blocks


def _primitives(
    mesh: SceneMesh, node: Node, materials: dict[int, int], buffer: _Buffer
) -> list[dict[str, Any]]:
    """One primitive per layer of a node, each with its own vertices."""
    primitives = []
    layers = mesh.layer[node.faces]
    for layer in np.unique(layers):
        corners = mesh.faces[node.faces[layers == layer]]
        used, indices = np.unique(corners, return_inverse=True)
        attributes = {
            "POSITION": y_up(mesh.vertices[used]),
            "NORMAL": y_up(unit(mesh.normals[used])),
            "TEXCOORD_0": mesh.uv[used].astype(np.float32),
            "COLOR_0": _colours(mesh.tint[used]),
        }
        primitives.append(
            {
                "attributes": {kind: buffer.add(kind, v) for kind, v in attributes.items()},
                "indices": buffer.add("indices", indices.ravel().astype(np.uint32)),
                "material": materials[int(layer)],
            }
        )
    return primitives


def y_up(vectors: Float) -> Float32:
    """Convert world vectors (n, 3) to glTF's axes: x east, y up, z south."""
    x, y, z = np.asarray(vectors, np.float32).T
    return np.stack([x, z, -y], axis=1)


def _colours(tint: Float) -> UInt8:
    """(n, 4) opaque grey factors of the textures; glTF limits them to 1."""
    colours = np.full((len(tint), 4), 255, np.uint8)
    colours[:, :3] = np.rint(255 * np.clip(tint, 0, 1))[:, None]
    return colours


def _material(layer: Layer, texture: int) -> dict[str, Any]:
    material: dict[str, Any] = {
        "name": layer.name.lower(),
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": texture},
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        },
        "doubleSided": True,
    }
    if is_cutout(layer):
        material |= {"alphaMode": "MASK", "alphaCutoff": _ALPHA_CUTOFF}
    return material


def _texture_file(textures: Textures, layer: Layer) -> tuple[str, bytes]:
    """Media type and file content of a layer's albedo in sRGB, with alpha for cut-out layers."""
    pixels = textures.albedo[layer * SIZE_PX**2 : (layer + 1) * SIZE_PX**2]
    pixels = pixels.reshape(SIZE_PX, SIZE_PX, 4)
    linear = (pixels[..., 2::-1] / 255.0) ** 2
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    colour = np.rint(curve * 255).astype(np.uint8)
    if not is_cutout(layer):
        options = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        return "image/jpeg", cv2.imencode(".jpg", colour, options)[1].tobytes()
    cut_out = np.concatenate([colour, pixels[..., 3:]], axis=-1)
    return "image/png", cv2.imencode(".png", cut_out)[1].tobytes()


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)


def _container(document: bytes, binary: bytes) -> bytes:
    """The file's header and two chunks, each padded to four bytes."""
    chunks = b""
    for kind, data in ((_JSON_CHUNK, _padded(document, b" ")), (_BINARY_CHUNK, binary)):
        chunks += struct.pack("<I4s", len(data), kind) + data
    return struct.pack("<4sII", _MAGIC, _VERSION, 12 + len(chunks)) + chunks
