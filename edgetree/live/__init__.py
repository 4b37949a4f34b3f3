"""Live: frames from cameras and recordings, stems followed over time, results as they come."""
