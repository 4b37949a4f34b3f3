// From a frame to the model's input, as the manifest says.
//
// A frame is { width, height, data }: BGR bytes for an rgb model, and for a depth model 16-bit
// millimetres (Uint16Array) or metres (Float32Array), where 0 is no reading. For a model of colour
// and depth it is { width, height, colour, depth }, of which one may be missing.

import { inputsOf } from "./manifest.js";

/** The nearest whole number; of two, the even one. */
function roundHalfEven(value) {
  const low = Math.floor(value);
  const rest = value - low;
  if (rest !== 0.5) return rest < 0.5 ? low : low + 1;
  return low % 2 === 0 ? low : low + 1;
}

/** Size of the resized frame at the top left of the model's input, and model px per frame px. */
export function letterbox(width, height, input) {
  const scale = Math.min(input.width / width, input.height / height);
  const side = (length, most) => Math.min(most, Math.max(1, roundHalfEven(length * scale)));
  const [w, h] = [side(width, input.width), side(height, input.height)];
  return { width: w, height: h, scaleX: w / width, scaleY: h / height };
}

/** A function from metres to an 8-bit grey. */
function greyOf({ near_m, far_m, near_value, far_value, invalid_value }) {
  const perMetre = (far_value - near_value) / (far_m - near_m);
  const offset = near_value - near_m * perMetre;
  const [low, high] = [Math.min(near_value, far_value), Math.max(near_value, far_value)];
  return (metres) =>
    metres > 0 && metres < Infinity
      ? Math.min(high, Math.max(low, roundHalfEven(metres * perMetre + offset)))
      : invalid_value;
}

const tables = new WeakMap(); // greys of all millimetres, by encoding

function tableOf(encoding) {
  if (!tables.has(encoding)) {
    const grey = greyOf(encoding);
    tables.set(encoding, Uint8Array.from({ length: 65536 }, (_, mm) => grey(mm / 1000)));
  }
  return tables.get(encoding);
}

/** Depth as 8-bit greys, before it is resized. */
function encodeDepth(data, encoding) {
  const bytes = new Uint8Array(data.length);
  if (data instanceof Uint16Array) {
    const table = tableOf(encoding);
    for (let i = 0; i < data.length; i++) bytes[i] = table[data[i]];
  } else {
    const grey = greyOf(encoding);
    for (let i = 0; i < data.length; i++) bytes[i] = grey(data[i]);
  }
  return bytes;
}

/** For each resized pixel of one axis: the first source pixel that it mixes, and the weights. */
function mixture(from, to, shrinking) {
  const step = from / to;
  return Array.from({ length: to }, (_, index) => {
    if (!shrinking) { // bilinear, between pixel centres
      const at = Math.min(from - 1, Math.max(0, (index + 0.5) * step - 0.5));
      const first = Math.min(Math.floor(at), Math.max(0, from - 2));
      return { first, weights: Float32Array.from(from > 1 ? [1 - (at - first), at - first] : [1]) };
    }
    const [begin, end] = [index * step, Math.min(from, (index + 1) * step)]; // mean of an area
    const first = Math.floor(begin);
    const weights = [];
    for (let source = first; source < end - 1e-9; source++)
      weights.push((Math.min(end, source + 1) - Math.max(begin, source)) / (end - begin));
    return { first, weights: Float32Array.from(weights) };
  });
}

/** Add a row of bytes, resized to the width of `columns` and times `weight`, to `line`. */
function addRow(line, bytes, start, channels, columns, weight) {
  for (let x = 0, to = 0; x < columns.length; x++) {
    const { first, weights } = columns[x];
    for (let c = 0; c < channels; c++, to++) {
      let sum = 0;
      let at = start + first * channels + c;
      for (let k = 0; k < weights.length; k++, at += channels) sum += weights[k] * bytes[at];
      line[to] += weight * sum;
    }
  }
}

/** Resize bytes and place them at the top left of the padded input. */
function resize(bytes, { width, height }, channels, box, input, padValue) {
  const shrinking = box.width < width;
  const columns = mixture(width, box.width, shrinking);
  const padded = new Uint8Array(input.width * input.height * channels).fill(padValue);
  const line = new Float32Array(box.width * channels);
  for (const [y, { first, weights }] of mixture(height, box.height, shrinking).entries()) {
    line.fill(0.5); // for rounding to the nearest
    for (const [k, weight] of weights.entries())
      addRow(line, bytes, (first + k) * width * channels, channels, columns, weight);
    padded.set(line, y * input.width * channels);
  }
  return padded;
}

/** One input's bytes, its name and shape; of an image that is missing, the value for nothing. */
function prepareOne(frame, input, box, encoding) {
  const channels = input.isDepth ? 1 : 3;
  const shape = [1, input.height, input.width, ...(channels === 3 ? [3] : [])];
  const { width, height } = frame;
  const data = input.canBeMissing ? frame[input.name] : frame.data;
  if (!data && input.canBeMissing) {
    const count = input.height * input.width * channels;
    return { name: input.name, shape, pixels: new Uint8Array(count).fill(input.nothing) };
  }
  if (data.length !== width * height * channels)
    throw new Error(`a frame has ${data.length} values: expected ${width}x${height}x${channels}`);
  const isEncoded = !input.isDepth || data instanceof Uint8Array;
  const bytes = isEncoded ? data : encodeDepth(data, encoding);
  const pixels = resize(bytes, frame, channels, box, input, input.pad_value);
  return { name: input.name, shape, pixels };
}

/** The model's inputs (name, shape, Uint8Array of pixels), and the letterbox to map points back. */
export function prepare(frame, manifest) {
  const box = letterbox(frame.width, frame.height, manifest.input);
  const inputs = inputsOf(manifest).map((input) =>
    prepareOne(frame, input, box, manifest.depth_encoding),
  );
  return { inputs, box };
}
