"""What every package of the project stands on; it knows neither trees nor cameras.

- `errors`: the root of the project's errors.
- `files`: read and write files, limits on what is read, names.
- `program`: the process of a command line, its console and its signals.
- `jobs`: work on several machines.
- `deprecation`: old import paths that go on for one version.
"""

__all__: list[str] = []
