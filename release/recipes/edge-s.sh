# edge-s: colour and depth, 800x480 px. edge-s-depth with a colour backbone, which sees the picture at
# half the size. The file lies in the repository's folder `models`, not in the package.
#
# As it was made, but for these:
# - Trainings were bounded by minutes. Here they take the steps that were reached.
# - It learned from all frames of its datasets, those of `val` and `test` among them.
# - The colour branch learned at 640x384 px first, beside edge-n-depth, and was then put beside
#   edge-s-depth. Here all is learned at 800x480 px.
# - Boxes are averaged without a training: that came after the trainings, as did that masks count in scores.
python -m release.make edge-s-depth
python -m release.make edge-n-rgb

perceptree synth --out data/paper-921 --preset paper --seed 921 --views 4 --frames 224
perceptree synth --out data/field-921 --preset field --seed 921 --views 3 --frames 165
perceptree synth --out data/both-paper-909 --preset paper --seed 909 --views 2 --frames 100
perceptree synth --out data/both-field-909 --preset field --seed 909 --views 2 --frames 100
perceptree synth --out data/both-field-905 --preset field --seed 905 --views 2 --width 640 --height 360 --frames 900
python -m release.join data/paper-921 data/field-921 data/both-paper-909 data/both-field-909 data/both-field-905 --out data/both-mixed
python -m release.join data/paper-921 data/field-921 data/both-paper-909 data/both-field-909 --out data/both-large

# The colour backbone's weights are held at first: only its way into the pyramid is learned, with the
# pyramid and the heads.
perceptree train data/both-mixed --init models/edge-s-depth.safetensors --init-colour models/edge-n-rgb.safetensors --recipe varied --freeze-level 5 --frozen-norms --learning-rate 0.0008 --evaluate-every 100000 --steps 1000 --out runs/b01
perceptree train data/both-mixed --init runs/b01/best.safetensors --recipe varied --freeze-level 3 --frozen-norms --backbone-rate 0.3 --learning-rate 0.0007 --evaluate-every 100000 --steps 2763 --out runs/b02
# Weights rounded to 7 bits, which the int8 file needs.
perceptree train data/both-large --init runs/b02/best.safetensors --branch runs/b02 --recipe varied --freeze-level 3 --frozen-norms --backbone-rate 0.3 --learning-rate 0.0007 --weight-bits 7 --evaluate-every 100000 --steps 1737 --out runs/b03

perceptree synth --out data/both-cal-paper --preset paper --seed 922 --views 3 --frames 100
perceptree synth --out data/both-cal-field --preset field --seed 922 --views 3 --frames 100
perceptree synth --out data/paper-924 --preset paper --seed 924 --views 3 --frames 240
perceptree synth --out data/field-924 --preset field --seed 924 --views 3 --frames 480
perceptree synth --out data/test --preset test
perceptree synth --out data/field-test --preset field-test
perceptree calibrate-scores runs/b03/best.safetensors data/both-cal-paper data/both-cal-field --split train --out runs/b03/scaled.safetensors
perceptree calibrate-scores runs/b03/scaled.safetensors data/paper-924 data/field-924 --split train --keep-level --out runs/b03/edge-s.safetensors

# More scenes, with the backbone at half the rate of the heads.
perceptree synth --out data/paper-927 --preset paper --seed 927 --views 3 --frames 900
perceptree synth --out data/field-927 --preset field --seed 927 --views 3 --frames 1740
python -m release.join data/paper-927 data/field-927 --out data/both-927
perceptree train data/both-927 --init runs/b03/edge-s.safetensors --recipe varied --freeze-level 0 --frozen-norms --backbone-rate 0.5 --learning-rate 0.0005 --weight-bits 7 --evaluate-every 100000 --seed 61 --steps 2078 --out runs/b04
# The same frames, with a rate that falls to a hundredth.
perceptree train data/both-927 --branch runs/b04 --evaluate-every 100000 --seed 62 --steps 2034 --out runs/b05
perceptree calibrate-scores runs/b05/best.safetensors data/paper-924 data/field-924 --split train --out runs/b05/edge-s.safetensors

# New scenes, half of each batch. The convolution of the proposals becomes a depthwise and a pointwise one.
perceptree synth --out data/paper-928 --preset paper --seed 928 --views 3 --frames 543
perceptree synth --out data/field-928 --preset field --seed 928 --views 3 --frames 453
python -m release.join data/paper-928 data/field-928 --out data/both-928
python -m release.separable runs/b05/edge-s.safetensors --out runs/b05/separable.safetensors
perceptree train data/both-928 --mix data/both-927 --init runs/b05/separable.safetensors --recipe varied --freeze-level 0 --frozen-norms --backbone-rate 0.5 --learning-rate 0.0005 --weight-bits 7 --evaluate-every 100000 --seed 63 --steps 2102 --out runs/b06
# The mean of the weights after and before: better than either.
perceptree average runs/b06/best.safetensors runs/b05/separable.safetensors --out runs/b06/mean.safetensors

perceptree calibrate-scores runs/b06/mean.safetensors data/paper-924 data/field-924 --split train --out models/edge-s.safetensors
edgetree export models/edge-s.safetensors --out models/edge-s.onnx --precision int8 --proposals 60 --calibration data/paper-924 --data data/test
python -m benchmarks.error_factor models/edge-s.onnx data/paper-924 data/field-924
python -m release.scenes models/edge-s.json --after models/edge-s-depth.json models/edge-n-rgb.json --training data/paper-921 data/field-921 data/both-paper-909 data/both-field-909 data/both-field-905 data/paper-927 data/field-927 data/paper-928 data/field-928 --scale data/both-cal-paper data/both-cal-field data/paper-924 data/field-924 --ranges data/paper-924
python -m release.cards --test data/test --field-test data/field-test --models models/edge-s.onnx --checkpoints models
python -m release.half models/edge-s.safetensors --out checkpoints/edge-s.safetensors
