# edge-n-depth for many depth cameras: it goes on from the repository's weights, all layers, and is not
# shipped yet. Half of each batch is exact depth on which each step draws another camera; the other half
# are the same frames as the simulator's cameras measure them, so that what was learned is kept.

# Frames of 1280x720 px, as for edge-n-depth: their exact depth has a sample for each pixel of the input.
perceptree synth --out data/paper-916 --preset paper --seed 916 --views 4 --frames 2400
perceptree synth --out data/field-917 --preset field --seed 917 --views 4 --frames 2400
python -m release.join data/paper-916 data/field-917 --out data/cameras-916

perceptree train data/cameras-916 --mix data/cameras-916 --exact-depth --init $RECIPES/../../checkpoints/edge-n-depth.safetensors --batch 32 --device cuda --precision fp32 --learning-rate 0.001 --seed 49 --evaluate-every 100000 --steps 6000 --out runs/m01
perceptree train data/cameras-916 --mix data/cameras-916 --exact-depth --init runs/m01/best.safetensors --branch runs/m01 --batch 32 --device cuda --precision fp32 --learning-rate 0.001 --seed 49 --evaluate-every 100000 --steps 2000 --out runs/m02
# Weights rounded to 7 bits, which the int8 file needs.
perceptree train data/cameras-916 --mix data/cameras-916 --exact-depth --init runs/m02/best.safetensors --batch 32 --device cuda --precision fp32 --learning-rate 0.0002 --weight-bits 7 --seed 50 --evaluate-every 100000 --steps 600 --out runs/m03

perceptree synth --out data/cal-paper --preset paper --seed 909 --views 2 --frames 160
perceptree synth --out data/cal-field --preset field --settings $RECIPES/field-former.json --seed 909 --views 2 --frames 160
perceptree synth --out data/test --preset test
perceptree synth --out data/field-test --preset field-test
perceptree calibrate-scores runs/m03/best.safetensors data/cal-paper data/cal-field --split train --out models/edge-n-depth-cameras.safetensors
edgetree export models/edge-n-depth-cameras.safetensors --out models/edge-n-depth-cameras.onnx --precision int8 --proposals 60 --calibration data/cal-paper --data data/test
python -m benchmarks.sensor_cards data/test data/field-test --frames 60 --models models/edge-n-depth-cameras.onnx edge-n-depth --result sensor_cards.json
