"""Programs that measure this project: speed, accuracy, studies. None of it is installed.

Each is run from the folder of the repository, `python -m benchmarks.NAME`, and says at its top what
it measures. Results are in `results`.
"""
