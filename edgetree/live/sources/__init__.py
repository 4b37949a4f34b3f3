"""Sources of live frames: recordings and cameras."""
