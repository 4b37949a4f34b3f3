// Finds trees in frames with a model file of edgetree, by onnxruntime in Node or in a browser.

import { readManifest } from "./manifest.js";
import { prepare } from "./prepare.js";
import { withinReach } from "./reach.js";
import { treesOf } from "./trees.js";

export class TreeDetector {
  constructor(ort, session, manifest) {
    this.ort = ort;
    this.session = session;
    this.manifest = manifest;
  }

  /** Open a model: `ort` is onnxruntime-node or onnxruntime-web, `model` the file's bytes. */
  static async load(ort, model, options = {}) {
    const manifest = readManifest(model);
    return new TreeDetector(ort, await ort.InferenceSession.create(model, options), manifest);
  }

  /**
   * The trees in a frame (see prepare.js), by descending score. With depth in millimetres or metres
   * and `frame.camera` ({ fx, fy, cx, cy } in px), those beyond the model's reach are left out.
   */
  async detect(frame, scoreThreshold = 0.5) {
    const { inputs, box } = prepare(frame, this.manifest);
    const images = {};
    for (const { name, pixels, shape } of inputs)
      images[name] = new this.ort.Tensor("uint8", pixels, shape);
    const outputs = await this.session.run(images);
    const trees = treesOf(outputs, this.manifest, box, frame, scoreThreshold);
    return withinReach(trees, this.manifest, frame, scoreThreshold);
  }
}
