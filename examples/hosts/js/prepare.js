// From a frame to the model's input, as the manifest says.
//
// A frame is { width, height, data }: BGR bytes for an rgb model, and for a depth model 16-bit
// millimetres (Uint16Array) or metres (Float32Array), where 0 is no reading. For a model of colour
// and depth it is { width, height, colour, depth }, of which one may be missing.

import { inputsOf } from "./manifest.js";
import { resizeRows, roundHalfEven } from "./resize.js";

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

/** Resize bytes and place them at the top left of the padded input. */
function resize(bytes, frame, channels, box, input, padValue) {
  const padded = new Uint8Array(input.width * input.height * channels).fill(padValue);
  const put = (y, values) => padded.set(values, y * input.width * channels);
  resizeRows(bytes, frame, box, channels, put);
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
  const all = inputsOf(manifest);
  if (all.every((input) => input.canBeMissing && !frame[input.name]))
    throw new Error(`a frame has no image: expected ${all.map(({ name }) => name).join(" or ")}`);
  const inputs = all.map((input) =>
    prepareOne(frame, input, box, manifest.depth_encoding),
  );
  return { inputs, box };
}
