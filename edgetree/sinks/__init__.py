"""Where results go: text files, pictures, reports, maps, bags, and controllers on the network.

Names are imported on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgetree.sinks.bag import BagSink
    from edgetree.sinks.map_origin import MapOrigin
    from edgetree.sinks.maps import GeoJsonSink, GeoPackageSink, open_map
    from edgetree.sinks.mqtt import MqttSink
    from edgetree.sinks.mqtt_settings import MqttSettings
    from edgetree.sinks.network import UdpSink
    from edgetree.sinks.pictures import CocoSink, PicturesSink
    from edgetree.sinks.report import ReportSink, StemReportSink
    from edgetree.sinks.sink import FileSink, Sink
    from edgetree.sinks.text_files import CsvSink, CsvTracksSink, JsonLinesSink, LinesSink
    from edgetree.sinks.video import VideoSink

__all__ = [
    "BagSink",
    "CocoSink",
    "CsvSink",
    "CsvTracksSink",
    "FileSink",
    "GeoJsonSink",
    "GeoPackageSink",
    "JsonLinesSink",
    "LinesSink",
    "MapOrigin",
    "MqttSettings",
    "MqttSink",
    "PicturesSink",
    "ReportSink",
    "Sink",
    "StemReportSink",
    "UdpSink",
    "VideoSink",
    "open_map",
]

_MODULES = {
    "BagSink": "bag",
    "MapOrigin": "map_origin",
    "GeoJsonSink": "maps",
    "GeoPackageSink": "maps",
    "open_map": "maps",
    "MqttSettings": "mqtt_settings",
    "MqttSink": "mqtt",
    "UdpSink": "network",
    "CocoSink": "pictures",
    "PicturesSink": "pictures",
    "ReportSink": "report",
    "StemReportSink": "report",
    "FileSink": "sink",
    "Sink": "sink",
    "CsvSink": "text_files",
    "CsvTracksSink": "text_files",
    "JsonLinesSink": "text_files",
    "LinesSink": "text_files",
    "VideoSink": "video",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
