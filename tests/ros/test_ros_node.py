"""The ROS 2 package, with stubs of rclpy and of the message classes: never with ROS itself."""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
import sys
import time
import tomllib
import xml.etree.ElementTree as ET
from array import array
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags")
from ros_stubs import Graph

from edgetree import sample_frames

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros" / "edgetree_ros"
INFO, DEPTH_INFO = "/color/camera_info", "/depth/camera_info"


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that imports the node with the stubs of a graph."""

    def import_node(graph: Graph) -> Any:
        for name, module in graph.modules().items():
            monkeypatch.setitem(sys.modules, name, module)
        for name in [name for name in sys.modules if name.startswith("edgetree_ros")]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.syspath_prepend(str(PACKAGE))
        return importlib.import_module("edgetree_ros.node")

    yield import_node
    for name in [name for name in sys.modules if name.startswith("edgetree_ros")]:
        del sys.modules[name]


class Camera:
    """The messages of a depth camera in front of a sample scene."""

    def __init__(self) -> None:
        self.sample = sample_frames()[0]
        self.msg: dict[str, Any] = {}

    def header(self, time_s: float) -> Any:
        stamp = self.kind("builtin_interfaces", "Time")(
            sec=int(time_s), nanosec=round(time_s % 1 * 1e9)
        )
        return self.kind("std_msgs", "Header")(stamp=stamp, frame_id="color_optical")

    def kind(self, package: str, name: str) -> Any:
        return getattr(sys.modules[f"{package}.msg"], name)

    def image(self, pixels: np.ndarray, encoding: str, time_s: float) -> Any:
        data = np.pad(pixels.reshape(len(pixels), -1).view(np.uint8), ((0, 0), (0, 8)))
        height, width = pixels.shape[:2]
        return self.kind("sensor_msgs", "Image")(
            header=self.header(time_s),
            height=height,
            width=width,
            encoding=encoding,
            step=data.shape[1],
            data=array("B", data.tobytes()),
        )

    def pair(self, time_s: float) -> tuple[Any, Any]:
        rgb = cv2.cvtColor(self.sample.image(), cv2.COLOR_BGR2RGB)
        depth = cv2.imread(str(self.sample.depth_path), cv2.IMREAD_UNCHANGED)
        return self.image(rgb, "rgb8", time_s), self.image(depth, "16UC1", time_s + 0.001)

    def info(self) -> Any:
        camera = self.sample.camera
        return self.kind("sensor_msgs", "CameraInfo")(
            header=self.header(1.0),
            width=camera.width,
            height=camera.height,
            distortion_model="plumb_bob",
            d=array("d", [0.0] * 5),
            k=np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]),
        )

    def imu(self, time_s: float) -> Any:
        push = self.kind("geometry_msgs", "Vector3")(x=0.0, y=-9.81, z=0.0)
        return self.kind("sensor_msgs", "Imu")(header=self.header(time_s), linear_acceleration=push)


def wait_for(graph: Graph, topic: str, count: int) -> None:
    end_s = time.monotonic() + 60
    while len(graph.published[topic]) < count:
        assert time.monotonic() < end_s, f"{topic}: {graph.published}"
        time.sleep(0.01)


def play(graph: Graph, start: Any, spin: Any) -> int:
    """Run the node's own main with a function in the place of `rclpy.spin`."""
    graph.spin = spin
    return start(graph).main()


def test_stems_are_published_as_detections_markers_and_json(start: Any) -> None:
    graph, camera = Graph(threads=1), Camera()

    def spin(node: Any) -> None:
        for topic in (INFO, DEPTH_INFO):
            graph.subscriptions[topic][0](camera.info())
        graph.subscriptions["/imu"][0](camera.imu(5.49))
        graph.take(*camera.pair(5.5))
        wait_for(graph, "~/json", 1)
        node.tick()
        raise KeyboardInterrupt

    assert play(graph, start, spin) == 0
    record = json.loads(graph.published["~/json"][0].data)
    assert (record["schema"], record["time_s"]) == ("edgetree.live/1", 5.5)
    metres = [tree["metres"] for tree in record["trees"]]
    assert sum("diameter_m" in each for each in metres) >= 3
    (found,) = graph.published["~/detections"]
    assert found.header.frame_id == "color_optical"
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (5, 500_000_000)
    assert len(found.detections) == len(record["tracks"])
    detection = found.detections[0]
    assert 0.05 < detection.bbox.size.x < 1.0
    assert len(detection.results[0].pose.covariance) == 36
    (markers,) = graph.published["~/markers"]
    assert any(re.fullmatch(r"1: [\d.]+ ± [\d.]+ cm", each.text) for each in markers.markers)
    (told,) = graph.published["/diagnostics"]
    (status,) = told.status
    assert (status.level, status.name) == (b"\0", "edgetree: trees")
    values = {pair.key: pair.value for pair in status.values}
    assert (values["state"], values["results"], values["without pose"]) == ("running", "1", "1")


def test_inputs_are_subscribed_to_as_drivers_publish(start: Any) -> None:
    graph = Graph(compressed=True, queue_size=4, max_time_difference=0.1)
    graph.remapped = {"color/image_raw": "/front/image", "imu": "/front/imu"}

    def spin(_: Any) -> None:
        raise KeyboardInterrupt

    assert play(graph, start, spin) == 0
    assert graph.pictures == [
        ("CompressedImage", "/front/image/compressed", "sensor data"),
        ("CompressedImage", "/depth/image_raw/compressedDepth", "sensor data"),
    ]
    assert graph.pairing == (4, 0.1)
    assert graph.subscriptions["/front/imu"][1] == "sensor data"
    assert graph.subscriptions["/tf_static"][1].durability == "transient local"
    assert graph.is_shut_down


def test_what_cannot_be_used_is_told_and_the_node_goes_on(start: Any) -> None:
    graph, camera = Graph(threads=1), Camera()

    def spin(node: Any) -> None:
        colour, depth = camera.pair(2.0)
        graph.take(camera.image(np.zeros((4, 4, 3), np.uint8), "no such", 1.0), depth)
        node.tick()
        graph.subscriptions[INFO][0](camera.info())
        graph.take(colour, depth)
        wait_for(graph, "~/json", 1)
        node.tick()
        raise KeyboardInterrupt

    assert play(graph, start, spin) == 0
    first, second = (message.status[0] for message in graph.published["/diagnostics"])
    assert (first.level, second.level) == (b"\1", b"\0")
    values = {pair.key: pair.value for pair in second.values}
    assert values["left out: unreadable images"] == "1"


@pytest.mark.parametrize(
    ("parameters", "line"),
    [
        ({"threads": "two"}, "parameter threads is 'two': expected a whole number"),
        ({"odometry": 1}, "parameter odometry: .*: expected true or false"),
        ({"stale_after": 1}, r"parameter stale_after: .*: expected a number with a point"),
        ({"queue_size": 1.5}, "parameter queue_size: .*: expected a whole number"),
        ({"model": 7}, "parameter model: .*: expected a text"),
        ({"queue_size": 0}, "parameter queue_size is 0: expected a number above 0"),
        ({"up": "0,1"}, "--up is '0,1': expected three numbers, such as 0,-1,0"),
        ({"model": "none.onnx"}, "none.onnx"),
    ],
)
def test_a_wrong_parameter_is_one_line(
    start: Any, capsys: pytest.CaptureFixture[str], parameters: dict[str, Any], line: str
) -> None:
    assert start(Graph(**parameters)).main() == 2
    told = capsys.readouterr().err
    assert told.startswith("edgetree_node: ")
    assert re.search(line, told)
    assert told.count("\n") == 1


def test_a_number_may_be_given_for_a_text(start: Any) -> None:
    graph = Graph(depth_scale=0.001, stump_height=1)
    node = start(graph)
    parameters = sys.modules["edgetree_ros.parameters"].read_parameters(
        sys.modules["rclpy.node"].Node("edgetree")
    )
    assert parameters.metres.depth_scale == "0.001"
    assert parameters.metres.stump_height == 1.0
    assert parameters.node == sys.modules["edgetree_ros.parameters"].NodeOptions()
    assert all(descriptor.description for _, descriptor in graph.declared.values())
    assert node.main is not None


def test_the_files_of_the_package_fit_together(start: Any) -> None:
    graph = Graph()
    start(graph)
    sys.modules["edgetree_ros.parameters"].read_parameters(
        sys.modules["rclpy.node"].Node("edgetree")
    )
    given = yaml.safe_load((PACKAGE / "config" / "edgetree.yaml").read_text("utf-8"))
    for name, value in given["/**"]["ros__parameters"].items():
        assert graph.declared[name][0] == value, name
    manifest = ET.parse(PACKAGE / "package.xml").getroot()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert manifest.findtext("version") == version
    assert f'version="{version}"' in (PACKAGE / "setup.py").read_text("utf-8")
    needed = {each.text for each in manifest.findall("exec_depend")}
    sources = "".join(path.read_text("utf-8") for path in (PACKAGE / "edgetree_ros").glob("*.py"))
    imported = set(re.findall(r"^(?:from|import) (\w+?)(?:\.\w+)* import", sources, re.MULTILINE))
    of_ros = {name for name in imported if name.endswith(("_msgs", "_interfaces"))} | {
        "rclpy",
        "message_filters",
    }
    assert of_ros <= needed
    launch = ET.parse(PACKAGE / "launch" / "edgetree.launch.xml").getroot()
    inputs = {remap.get("from") for remap in launch.iter("remap")}
    assert inputs == set(sys.modules["edgetree_ros.node"]._INPUTS.values())
    variables = set(re.findall(r"\$\(var (\w+)\)", ET.tostring(launch, "unicode")))
    assert variables == {arg.get("name") for arg in launch.iter("arg")}


def test_colcon_finds_the_package_where_ros_looks(tmp_path: Path) -> None:
    """The marker, the files of the package and the program, for the Python that is active."""
    copy = tmp_path / "source"
    shutil.copytree(PACKAGE, copy)
    install = ("install", "--prefix", tmp_path / "install", "--single-version-externally-managed")
    done = subprocess.run(
        [sys.executable, "setup.py", "-q", *install, "--record", tmp_path / "files.txt"],
        cwd=copy,
        capture_output=True,
        text=True,
        check=False,
    )
    if "invalid command" in done.stderr:
        pytest.skip("this setuptools installs no packages as colcon does")
    assert done.returncode == 0, done.stderr
    share = tmp_path / "install" / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "edgetree_ros").is_file()
    for name in ("package.xml", "launch/edgetree.launch.xml", "config/edgetree.yaml"):
        assert (share / "edgetree_ros" / name).is_file()
    program = tmp_path / "install" / "lib" / "edgetree_ros" / "edgetree_node"
    assert program.read_text("utf-8").splitlines()[0] == "#!/usr/bin/env python3"
