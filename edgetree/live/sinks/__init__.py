"""Where live results go: files, a map of the stems, and controllers on the network."""

from edgetree.live.sinks.bag import BagSink
from edgetree.live.sinks.csv_tracks import CsvTracksSink
from edgetree.live.sinks.geojson import GeoJsonSink
from edgetree.live.sinks.geopackage import GeoPackageSink
from edgetree.live.sinks.json_lines import JsonLinesSink
from edgetree.live.sinks.map_origin import MapOrigin
from edgetree.live.sinks.mqtt import MqttSink
from edgetree.live.sinks.records import LIVE_SCHEMA, STEMS_SCHEMA, live_record, stems_message
from edgetree.live.sinks.sink import Sink
from edgetree.live.sinks.udp import UdpSink

__all__ = [
    "LIVE_SCHEMA",
    "STEMS_SCHEMA",
    "BagSink",
    "CsvTracksSink",
    "GeoJsonSink",
    "GeoPackageSink",
    "JsonLinesSink",
    "MapOrigin",
    "MqttSink",
    "Sink",
    "UdpSink",
    "live_record",
    "stems_message",
]
