"""Programs that time one file, each in the environment of its runtime."""
