"""The old name of `edgetree.sinks`, which goes on for one version with a warning."""

from basetree.deprecation import moved_names

__all__: list[str] = []

_SINKS = (
    "BagSink",
    "CsvTracksSink",
    "GeoJsonSink",
    "GeoPackageSink",
    "JsonLinesSink",
    "MapOrigin",
    "MqttSink",
    "Sink",
    "UdpSink",
)
_RECORDS = ("LIVE_SCHEMA", "STEMS_SCHEMA", "live_record", "stems_message")
__getattr__ = moved_names(
    __name__,
    {name: f"edgetree.sinks.{name}" for name in _SINKS}
    | {name: f"edgetree.results.{name}" for name in _RECORDS},
)
