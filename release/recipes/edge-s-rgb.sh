# edge-s-rgb: the weights of edge-n-rgb at 800x480 px. Its scores are not scaled.
python -m release.make colour

# A checkpoint has the input size of the first one that it is the average of.
perceptree average runs/average-s.safetensors runs/heads/best.safetensors --out models/edge-s-rgb.safetensors
edgetree export models/edge-s-rgb.safetensors --out models/edge-s-rgb.onnx --precision int8 --proposals 60 --calibration data/field-924 --data data/test
python -m benchmarks.error_factor models/edge-s-rgb.onnx data/paper-924 data/field-924
python -m release.scenes models/edge-s-rgb.json --training data/rgb-paper-905 data/rgb-field-905 data/rgb-paper-907 data/rgb-field-907 data/former-905 data/field-911 data/far-paper-907 --ranges data/field-924
python -m release.cards --test data/test --field-test data/field-test --models models/edge-s-rgb.onnx --checkpoints models
