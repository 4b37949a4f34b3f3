"""Binary glTF: a reader gets the same scene."""

import dataclasses
import errno
import json
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import cv2
import numpy as np
import pytest

from basetree.files.writing import replacing
from perceptree.errors import DatasetError
from perceptree.simulator.geometry import gltf
from perceptree.simulator.geometry.assemble import assemble
from perceptree.simulator.geometry.gltf import gltf_bytes, scene_nodes, write_gltf
from perceptree.simulator.geometry.prototypes import make_prototypes
from perceptree.simulator.materials.layers import FIRST_CUTOUT, SIZE_PX, Layer
from perceptree.simulator.scene.description import describe_scene
from perceptree.simulator.settings.presets import PRESETS

COMPONENTS = {5126: np.float32, 5121: np.uint8, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TREES = ("fir_grey", "beech_smooth")
MAX_REACH_M = 9  # of a crown and a leaning stem; with 25 stems per hectare trees are farther apart


def small_scene() -> SimpleNamespace:
    """A ground, two trees with stem and crown, and a tuft; each is a strip of four faces."""
    rng = np.random.default_rng(0)
    instances, strip = 6, 6
    corners = np.array([[n, n + 1, n + 2] for n in range(strip - 2)])
    faces = np.concatenate([corners + strip * n for n in range(instances)])
    layers = [
        Layer.MOSS,
        Layer.FIR_GREY,
        Layer.FIR_TWIG,
        Layer.BEECH_SMOOTH,
        Layer.BEECH_LEAVES,
        Layer.GRASS,
    ]
    vertices = rng.uniform(-20, 20, (instances * strip, 3)).astype(np.float32)
    normals = rng.normal(size=vertices.shape).astype(np.float32)
    return SimpleNamespace(
        vertices=vertices,
        normals=normals,
        uv=rng.random((len(vertices), 2)).astype(np.float32),
        tint=np.linspace(0.2, 1.2, len(vertices), dtype=np.float32),
        faces=faces.astype(np.int32),
        layer=np.repeat(np.array(layers, np.uint8), strip - 2),
        tree_start=np.array([1, 3, 5]) * (strip - 2),
    )


def flat_textures() -> SimpleNamespace:
    """Each layer in a different plain colour, with cut-outs half transparent."""
    albedo = np.zeros((len(Layer), SIZE_PX, SIZE_PX, 4), np.uint8)
    for layer in Layer:
        albedo[layer, ..., :3] = (10 + 5 * layer, 100, 200)
        albedo[layer, :, : SIZE_PX // 2, 3] = 255
    return SimpleNamespace(albedo=albedo.reshape(-1, 4))


class Glb:
    """A minimal reader, written from the specification."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.document: dict[str, Any] = json.loads(data[20 : 20 + size])
        binary_size, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        self.binary = data[28 + size :]
        assert len(self.binary) == binary_size == self.document["buffers"][0]["byteLength"]

    def view(self, number: int) -> bytes:
        view = self.document["bufferViews"][number]
        return self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def array(self, number: int) -> np.ndarray:
        accessor = self.document["accessors"][number]
        width, dtype = WIDTHS[accessor["type"]], COMPONENTS[accessor["componentType"]]
        assert accessor["byteOffset"] % 4 == 0
        values = np.frombuffer(
            self.view(accessor["bufferView"]),
            dtype,
            accessor["count"] * width,
            accessor["byteOffset"],
        )
        return values.reshape(-1, width)


@pytest.fixture(scope="module")
def glb() -> Glb:
    scene = small_scene()
    return Glb(gltf_bytes(scene, scene_nodes(scene, TREES), flat_textures()))


def test_ground_trees_and_undergrowth_are_nodes_by_name(glb: Glb):
    document = glb.document
    names = [document["nodes"][number]["name"] for number in document["scenes"][0]["nodes"]]
    assert names == ["ground", "tree_001_fir_grey", "tree_002_beech_smooth", "undergrowth"]
    layers = [
        [document["materials"][p["material"]]["name"] for p in mesh["primitives"]]
        for mesh in document["meshes"]
    ]
    assert layers == [
        ["moss"],
        ["fir_grey", "fir_twig"],
        ["beech_smooth", "beech_leaves"],
        ["grass"],
    ]


def test_triangles_are_the_scenes_with_y_up(glb: Glb):
    scene, found = small_scene(), []
    for mesh in glb.document["meshes"]:
        for primitive in mesh["primitives"]:
            corners = glb.array(primitive["indices"]).ravel()
            found.append(glb.array(primitive["attributes"]["POSITION"])[corners])
    x, y, z = np.concatenate(found).T
    expected = scene.vertices[scene.faces.ravel()]
    assert np.array_equal(np.stack([x, -z, y], 1), expected)


@pytest.mark.parametrize("preset", ["paper", "field"])
def test_a_simulated_scene_is_split_into_its_trees_and_nothing_is_lost(preset: str):
    settings = PRESETS[preset].settings
    stand = dataclasses.replace(settings.stand, stems_per_ha=(25, 25))
    scene = describe_scene(dataclasses.replace(settings, stand=stand), 3)
    mesh = assemble(scene, make_prototypes())
    nodes = scene_nodes(mesh, [tree.stem.model.name for tree in scene.trees])
    assert np.array_equal(np.concatenate([n.faces for n in nodes]), np.arange(len(mesh.faces)))
    assert len(nodes) == len(scene.trees) + 2
    for number, (tree, node) in enumerate(zip(scene.trees, nodes[1:-1], strict=True), start=1):
        assert node.name == f"tree_{number:03d}_{tree.stem.model.name}"
        assert set(mesh.object_id[node.faces]) <= {0, number}
        corners = mesh.vertices[mesh.faces[node.faces]].reshape(-1, 3)
        assert corners[:, 2].min() <= tree.position_m[2]
        assert np.abs(corners[:, :2] - tree.position_m[:2]).max() < MAX_REACH_M
    assert not mesh.object_id[nodes[-1].faces].any()
    glb = Glb(gltf_bytes(mesh, nodes, flat_textures()))
    counts = [a["count"] for a in glb.document["accessors"] if a["type"] == "SCALAR"]
    assert sum(counts) == 3 * len(mesh.faces)


def test_bounds_normals_and_colours_are_what_the_format_wants(glb: Glb):
    tints = []
    for mesh in glb.document["meshes"]:
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            positions = glb.array(attributes["POSITION"])
            accessor = glb.document["accessors"][attributes["POSITION"]]
            assert accessor["min"] == positions.min(0).tolist()
            assert accessor["max"] == positions.max(0).tolist()
            lengths = np.linalg.norm(glb.array(attributes["NORMAL"]), axis=1)
            assert lengths == pytest.approx(1, abs=1e-5)
            colour = glb.array(attributes["COLOR_0"])
            assert (colour[:, 3] == 255).all()
            tints += colour[:, 0].tolist()
    assert tints[0] == 51
    assert max(tints) == 255


def test_textures_are_srgb_and_cut_out_where_the_layer_is(glb: Glb):
    document = glb.document
    for material in document["materials"]:
        texture = material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
        image = document["images"][document["textures"][texture]["source"]]
        layer = Layer[material["name"].upper()]
        assert image["name"] == material["name"]
        pixels = cv2.imdecode(
            np.frombuffer(glb.view(image["bufferView"]), np.uint8), cv2.IMREAD_UNCHANGED
        )
        linear = np.array([200, 100, 10 + 5 * layer]) ** 2 / 255**2
        expected = 255 * (1.055 * linear ** (1 / 2.4) - 0.055)
        assert pixels[5, 5, :3] == pytest.approx(expected, abs=2.5)
        if layer >= FIRST_CUTOUT:
            assert (material["alphaMode"], material["alphaCutoff"]) == ("MASK", 0.5)
            assert image["mimeType"] == "image/png"
            assert (pixels[5, 5, 3], pixels[5, -5, 3]) == (255, 0)
        else:
            assert "alphaMode" not in material
            assert image["mimeType"] == "image/jpeg"


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, monkeypatch):
    @contextmanager
    def fill(path: Path) -> Iterator[BinaryIO]:
        with replacing(path) as file:
            yield file
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(gltf, "replacing", fill)
    scene = small_scene()
    with pytest.raises(DatasetError, match=r"scene.glb: cannot be written \(No space left"):
        write_gltf(tmp_path / "scene.glb", scene, scene_nodes(scene, TREES), flat_textures())
    assert list(tmp_path.iterdir()) == []
