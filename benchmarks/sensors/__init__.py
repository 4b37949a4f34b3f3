"""How well stems are measured with cameras of other sizes and kinds, and by which outlines.

python -m benchmarks.sensors.run
python -m benchmarks.sensors.run control portrait --seeds 1000 1036

`control` ray-casts cylinders of 13 to 32 cm in front of the simulator's sensor models: stereo, time
of flight and exact depth in four sizes. `phone`, `portrait` and `scan` are real: stems with a tape
around them by a phone's time-of-flight camera, 24 captures of one stem with a root flare, and depth
views of a laser scan of pines; `cloud` is that scan itself, as `edgetree run` sees it. Each is
measured with the outlines of the packaged depth files, and where there are others with these: exact
ones in `control`, those of the depth alone in `phone` and `portrait`. Constants are chosen on seeds
below 1000 and reported on seeds from 1000 on. The real captures are in `../shared/data`.
"""
