"""What becomes of a frame's trees: JSON, tables, labels and pictures, in files that are whole."""

from edgetree.results.json_records import frame_record

__all__ = ["frame_record"]
