// Opens a model in WebAssembly, with SIMD and as many threads as the page may use.

import * as ort from "/ort/ort.wasm.min.mjs";

import { TreeDetector } from "/js/detector.js";

ort.env.wasm.wasmPaths = "/ort/";

export function openModel(bytes, threads) {
  ort.env.wasm.numThreads = window.crossOriginIsolated ? threads : 1;
  return TreeDetector.load(ort, bytes, { executionProviders: ["wasm"] });
}
