"""Programs that make what a version ships: models, cards, frozen test sets, sample frames.

Each is run from the folder of the repository, `python -m release.NAME`. `RELEASING.md` says when.
"""
