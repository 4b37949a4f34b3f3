// Resizing of bytes that gives OpenCV's values exactly, since an 8-bit network answers to one grey.

const ONE = 2048; // fixed-point 1 of bilinear weights

/** The nearest whole number; of two, the even one. */
export function roundHalfEven(value) {
  const low = Math.floor(value);
  const rest = value - low;
  if (rest !== 0.5) return rest < 0.5 ? low : low + 1;
  return low % 2 === 0 ? low : low + 1;
}

/** For each resized pixel of one axis: the source pixels whose mean it is, and their weights. */
function areas(from, to) {
  const step = from / to;
  return Array.from({ length: to }, (_, index) => {
    const [begin, end] = [index * step, index * step + step];
    const size = Math.min(step, from - begin);
    const last = Math.min(Math.floor(end), from - 1);
    const first = Math.min(Math.ceil(begin), last);
    const [sources, weights] = [[], []];
    const add = (source, weight) => { sources.push(source); weights.push(weight); };
    if (first - begin > 1e-3) add(first - 1, (first - begin) / size);
    for (let source = first; source < last; source++) add(source, 1 / size);
    if (end - last > 1e-3) add(last, Math.min(end - last, 1, size) / size);
    return { sources, weights: Float32Array.from(weights) };
  });
}

/** The two source pixels between whose centres each resized pixel lies, and their weights. */
function neighbours(from, to, isRow) {
  const step = from / to;
  return Array.from({ length: to }, (_, index) => {
    const at = Math.fround((index + 0.5) * step - 0.5);
    let first = Math.floor(at);
    let rest = Math.fround(at - first);
    if (!isRow && (first < 0 || first >= from - 1)) {
      first = first < 0 ? 0 : from - 1;
      rest = 0;
    }
    const sources = [first, first + 1].map((each) => Math.min(from - 1, Math.max(0, each)));
    const weights = [Math.fround(1 - rest), rest].map((each) => roundHalfEven(each * ONE));
    return { sources, weights };
  });
}

/** Mix the pixels of a row of bytes as `columns` say, in the precision of `line`'s numbers. */
function mixRow(line, bytes, start, channels, columns) {
  for (let x = 0, to = 0; x < columns.length; x++) {
    const { sources, weights } = columns[x];
    for (let c = 0; c < channels; c++, to++) {
      let sum = 0;
      for (let k = 0; k < weights.length; k++) {
        const part = weights[k] * bytes[start + sources[k] * channels + c];
        sum = Math.fround(sum + Math.fround(part));
      }
      line[to] = sum;
    }
  }
}

/** Mean of areas. Halves become even numbers, or go up where the frame is halved both ways. */
function shrink(bytes, from, to, channels, put) {
  const isHalf = 2 * to.width === from.width && 2 * to.height === from.height;
  const round = isHalf ? (value) => Math.floor(value + 0.5) : roundHalfEven;
  const columns = areas(from.width, to.width);
  const [line, sums] = [0, 0].map(() => new Float32Array(to.width * channels));
  let mixed = -1; // the source row in `line`: neighbours share one
  for (const [y, { sources, weights }] of areas(from.height, to.height).entries()) {
    sums.fill(0);
    for (let k = 0; k < sources.length; k++) {
      if (sources[k] !== mixed)
        mixRow(line, bytes, (mixed = sources[k]) * from.width * channels, channels, columns);
      for (let i = 0; i < sums.length; i++) sums[i] += Math.fround(weights[k] * line[i]);
    }
    put(y, sums.map(round));
  }
}

/** Bilinear interpolation with whole numbers. */
function enlarge(bytes, from, to, channels, put) {
  const columns = neighbours(from.width, to.width, false);
  const lines = [0, 0].map(() => new Int32Array(to.width * channels));
  for (const [y, { sources, weights }] of neighbours(from.height, to.height, true).entries()) {
    for (const [k, line] of lines.entries())
      mixRow(line, bytes, sources[k] * from.width * channels, channels, columns);
    const part = (k, i) => (weights[k] * (lines[k][i] >> 4)) >> 16;
    put(y, lines[0].map((_, i) => (part(0, i) + part(1, i) + 2) >> 2));
  }
}

/**
 * Resize a frame's bytes: the mean of areas if it becomes narrower, else bilinear interpolation.
 * `put(y, values)` is called with each resized row.
 */
export function resizeRows(bytes, from, to, channels, put) {
  (to.width < from.width ? shrink : enlarge)(bytes, from, to, channels, put);
}
