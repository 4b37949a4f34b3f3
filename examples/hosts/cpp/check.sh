#!/usr/bin/env bash
# Builds the program with OpenVINO's Python wheel, makes a conformance kit, finds its trees and
# checks them. Usage: check.sh [MODEL]; edgetree, CMake and a compiler have to be on the path.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
python3 -m venv build/venv
build/venv/bin/pip install --quiet openvino==2026.4.1
package=$(build/venv/bin/python -c 'import openvino; print(openvino.__path__[0])')
cmake -S . -B build -DOpenVINO_DIR="$package/cmake"
cmake --build build
edgetree conformance make "${1:-rgb}" --out build/kit
build/run_kit build/kit build/results.json
edgetree conformance check build/kit build/results.json
