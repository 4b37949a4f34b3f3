# edge-s-any: edge-s in one file with edge-s-rgb, for frames without depth, and edge-s-depth, for frames
# without colour. It needs no training of its own.
python -m release.make edge-s
python -m release.make edge-s-rgb
python -m release.make edge-s-depth

edgetree combine models/edge-s.onnx --colour models/edge-s-rgb.onnx --depth models/edge-s-depth.onnx --out models/edge-s-any.onnx
python -m release.scenes models/edge-s-any.json --holds models/edge-s.json models/edge-s-rgb.json models/edge-s-depth.json
python -m release.cards --test data/test --field-test data/field-test --models models/edge-s-any.onnx --checkpoints models
