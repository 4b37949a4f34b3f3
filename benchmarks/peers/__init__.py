"""Other detectors beside this project's files, each in an environment of its own."""
