// Reads the manifest of a model file of edgetree: one JSON text in the metadata of the ONNX file.
//
// An ONNX file is one protobuf message. Its field 14 holds pairs of a key and a value, and the
// graph with all weights is another field, which is skipped by its length.

const KEY = "edgetree.manifest";
const SCHEMA = "edgetree.manifest/1";
const METADATA = 14;
const BYTES = 2; // the wire type of texts and messages

/** The fields of a protobuf message that hold bytes, as [number, bytes]. */
function* fields(message) {
  let at = 0;
  const varint = () => {
    let value = 0;
    for (let factor = 1; at < message.length; factor *= 128) {
      const byte = message[at++];
      value += (byte & 127) * factor; // no shifts: lengths may exceed 32 bits
      if (byte < 128) return value;
    }
    throw new Error("not an ONNX file: it ends within a number");
  };
  while (at < message.length) {
    const tag = varint();
    const number = Math.floor(tag / 8);
    const kind = tag % 8;
    if (kind === 0) varint();
    else if (kind === 1) at += 8;
    else if (kind === 5) at += 4;
    else if (kind === BYTES) {
      const length = varint();
      if (at + length > message.length) throw new Error("not an ONNX file: it ends within a field");
      yield [number, message.subarray(at, at + length)];
      at += length;
    } else throw new Error(`not an ONNX file: a field has the wire type ${kind}`);
  }
}

/** The graph's inputs; a model of one input takes what `modality` says. */
export function inputsOf({ input, inputs, modality, resize }) {
  const all = inputs?.length ? inputs : [{ ...input, pad_value: resize.pad_value }];
  return all.map((each) => ({
    ...each,
    isDepth: each.colour_order === "depth",
    canBeMissing: modality === "both",
  }));
}

/** The manifest in the bytes of a model file (Uint8Array). */
export function readManifest(model) {
  const text = new TextDecoder();
  for (const [number, entry] of fields(model)) {
    if (number !== METADATA) continue;
    const [key, value] = [...fields(entry)].map(([, bytes]) => text.decode(bytes));
    if (key !== KEY) continue;
    const manifest = JSON.parse(value);
    if (manifest.schema !== SCHEMA)
      throw new Error(`the manifest has the schema ${manifest.schema}: expected ${SCHEMA}`);
    return manifest;
  }
  throw new Error("the file has no manifest: expected a model of `edgetree export`");
}
