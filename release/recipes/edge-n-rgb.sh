# edge-n-rgb: the colour weights at 640x384 px. Its scores are not scaled.
python -m release.make colour

perceptree average runs/average-n.safetensors runs/heads/best.safetensors --out models/edge-n-rgb.safetensors
edgetree export models/edge-n-rgb.safetensors --out models/edge-n-rgb.onnx --precision int8 --proposals 60 --calibration data/field-924 --data data/test
python -m benchmarks.error_factor models/edge-n-rgb.onnx data/paper-924 data/field-924
python -m release.scenes models/edge-n-rgb.json --training data/rgb-paper-905 data/rgb-field-905 data/rgb-paper-907 data/rgb-field-907 data/former-905 data/field-911 data/far-paper-907 --ranges data/field-924
python -m release.cards --test data/test --field-test data/field-test --models models/edge-n-rgb.onnx --checkpoints models
python -m release.half models/edge-n-rgb.safetensors --out checkpoints/edge-n-rgb.safetensors
