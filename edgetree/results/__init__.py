"""Output of results: JSON, tables, COCO labels and pictures, written atomically."""

from edgetree.results.json_records import frame_record

__all__ = ["frame_record"]
