// Runs a conformance kit of `edgetree conformance make`, in Node or in a browser.

/** A frame of a kit, as prepare.js takes it; `read(name)` gives the bytes of a file. */
export async function frameOf({ width, height, channels, file, depth_file, camera }, read) {
  const millimetres = (bytes) => new Uint16Array(bytes.slice().buffer); // little-endian
  const bytes = await read(file);
  if (depth_file)
    return { width, height, camera, colour: bytes, depth: millimetres(await read(depth_file)) };
  if (channels === 3) return { width, height, data: bytes, colour: bytes };
  const depth = millimetres(bytes);
  return { width, height, camera, data: depth, depth };
}

const median = (values) => {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
};

/**
 * What the detector finds in a kit, as the object to write.
 *
 * `read(name)` gives the bytes of a file of the kit; `about` says host, processor and threads;
 * `rounds` passes over the frames are timed.
 */
export async function runKit(kit, detector, read, about, rounds = 0) {
  const frames = [];
  for (const entry of kit.frames) frames.push(await frameOf(entry, read));
  const found = [];
  for (const [index, frame] of frames.entries()) {
    const trees = await detector.detect(frame, kit.score_threshold);
    found.push({ name: kit.frames[index].name, trees });
  }
  const times = [];
  for (let round = 0; round < rounds; round++) {
    for (const frame of frames) {
      const begin = performance.now();
      await detector.detect(frame, kit.score_threshold);
      times.push(performance.now() - begin);
    }
  }
  const { versions } = detector.ort.env;
  return {
    schema: "edgetree.conformance-results/1",
    model_sha256: kit.model_sha256,
    runtime: "onnxruntime",
    runtime_version: versions.node ?? versions.web,
    ...about,
    median_ms: times.length ? median(times) : null,
    frames: found,
  };
}
