"""Where results go: text files, pictures, reports, maps, bags, and controllers on the network."""

from edgetree.sinks.bag import BagSink
from edgetree.sinks.map_origin import MapOrigin
from edgetree.sinks.maps import GeoJsonSink, GeoPackageSink, open_map
from edgetree.sinks.network import MqttSink, UdpSink
from edgetree.sinks.pictures import CocoSink, PicturesSink
from edgetree.sinks.report import ReportSink, StemReportSink
from edgetree.sinks.sink import FileSink, Sink
from edgetree.sinks.text_files import CsvSink, CsvTracksSink, JsonLinesSink

__all__ = [
    "BagSink",
    "CocoSink",
    "CsvSink",
    "CsvTracksSink",
    "FileSink",
    "GeoJsonSink",
    "GeoPackageSink",
    "JsonLinesSink",
    "MapOrigin",
    "MqttSink",
    "PicturesSink",
    "ReportSink",
    "Sink",
    "StemReportSink",
    "UdpSink",
    "open_map",
]
