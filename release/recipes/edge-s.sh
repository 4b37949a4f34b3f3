# edge-s: colour and depth, 800x480 px. edge-s-depth with a colour backbone, which sees the picture at
# half the size. The file lies in the repository's folder `models`, not in the package.
#
# As it was made, but for these:
# - Trainings were bounded by minutes. Here they take the steps that were reached.
# - It learned from all frames of its datasets, those of `val` and `test` among them.
# - The colour branch learned at 640x384 px first, beside edge-n-depth, and was then put beside
#   edge-s-depth. Here all is learned at 800x480 px.
python -m release.make edge-s-depth
python -m release.make edge-n-rgb

perceptree synth --out data/paper-921 --preset paper --seed 921 --views 4 --frames 224
perceptree synth --out data/field-921 --preset field --seed 921 --views 3 --frames 165
perceptree synth --out data/both-paper-909 --preset paper --seed 909 --views 2 --frames 100
perceptree synth --out data/both-field-909 --preset field --seed 909 --views 2 --frames 100
perceptree synth --out data/both-field-905 --preset field --seed 905 --views 2 --width 640 --height 360 --frames 900
python -m release.join data/paper-921 data/field-921 data/both-paper-909 data/both-field-909 data/both-field-905 --out data/both-mixed
python -m release.join data/paper-921 data/field-921 data/both-paper-909 data/both-field-909 --out data/both-large
