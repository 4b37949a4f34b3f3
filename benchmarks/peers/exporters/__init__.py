"""Programs that make the peers' files, each in the environment of its peer."""
