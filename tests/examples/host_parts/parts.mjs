// What the JavaScript hosts do before and after the network: node parts.mjs KIT OUTPUTS OUT
//
// OUTPUTS/NAME.json holds the network's outputs for a frame of the kit.

import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";

import { frameOf } from "../../../examples/hosts/js/kit.js";
import { readManifest } from "../../../examples/hosts/js/manifest.js";
import { prepare } from "../../../examples/hosts/js/prepare.js";
import { withinReach } from "../../../examples/hosts/js/reach.js";
import { treesOf } from "../../../examples/hosts/js/trees.js";

const [folder, outputs, out] = process.argv.slice(2);
const read = (...parts) => new Uint8Array(readFileSync(path.join(...parts)));
const json = (...parts) => JSON.parse(new TextDecoder().decode(read(...parts)));
const kit = json(folder, "kit.json");
const manifest = readManifest(read(folder, kit.model));
const trees = {};
for (const entry of kit.frames) {
  const { name } = entry;
  const frame = await frameOf(entry, (file) => read(folder, file));
  const { inputs, box } = prepare(frame, manifest);
  for (const { name: input, pixels } of inputs)
    writeFileSync(path.join(out, `${name}.${input}.raw`), pixels);
  const tensors = {};
  for (const [key, { shape, values }] of Object.entries(json(outputs, `${name}.json`)))
    tensors[key] = { dims: shape, data: Float32Array.from(values) };
  const found = treesOf(tensors, manifest, box, frame, kit.score_threshold);
  trees[name] = withinReach(found, manifest, frame, kit.score_threshold);
}
writeFileSync(path.join(out, "trees.json"), JSON.stringify(trees));
