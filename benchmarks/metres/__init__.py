"""Ray-traced scenes of stems that are hard to measure, and how well the intervals hold on them.

python -m benchmarks.metres.run --seeds 1000 1060
python -m benchmarks.metres.run branch netting --seeds 1000 1040

The ray caster (`caster`) knows cones with oval sections, ground with bumps, and layers of plants or
snow; it shares nothing with the simulator and with the measurement but the pinhole projection.
`stand` puts stems into a scene and keeps their true values; `sensors` has the faults of depth
cameras. Every function listed in a module of `rows` draws one scene from a random generator, and
`scores` prints for each row and quantity: how many values are given, bias and root mean square of
their errors, the shares inside the stated intervals at five levels, and the share beyond three
standard deviations. Constants are chosen on seeds below 1000 and reported on seeds from 1000 on.
"""
