#!/usr/bin/env bash
# Installs the packages, makes a conformance kit, finds its trees and checks them.
# Usage: check.sh [MODEL]; edgetree has to be on the path.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
npm ci --no-audit --no-fund
edgetree conformance make "${1:-edge-n-rgb}" --out kit
node run-kit.js kit results.json
edgetree conformance check kit results.json
