// Finds the trees of a conformance kit: node run-kit.js KIT RESULTS.json [THREADS] [ROUNDS]

process.env.ORT_DISABLE_TELEMETRY ??= "1"; // onnxruntime sends usage data to its maker otherwise

import { readFile, writeFile } from "node:fs/promises";
import path from "node:path";

import { TreeDetector } from "../js/detector.js";
import { runKit } from "../js/kit.js";

const ort = await import("onnxruntime-node");

const [folder, out, threads = "2", rounds = "0"] = process.argv.slice(2);
if (!out) {
  console.error("usage: node run-kit.js KIT RESULTS.json [THREADS] [ROUNDS]");
  process.exit(2);
}
const read = (name) => readFile(path.join(folder, name)).then((data) => new Uint8Array(data));
const kit = JSON.parse(await readFile(path.join(folder, "kit.json"), "utf8"));
const detector = await TreeDetector.load(ort, await read(kit.model), {
  intraOpNumThreads: Number(threads),
  extra: { session: { intra_op: { allow_spinning: "0" } } }, // leave idle cores to others
});
const about = {
  host: "examples/hosts/node",
  processor: { x64: "x86-64" }[process.arch] ?? process.arch,
  threads: Number(threads),
};
const results = await runKit(kit, detector, read, about, Number(rounds));
await writeFile(out, JSON.stringify(results));
