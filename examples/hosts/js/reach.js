// Leaves out trees beyond the reach of the model's labels, by depth and camera.
//
// The network sees depth along the optical axis. How far a stem at the edge of a wide picture stands
// from the camera is computed here, as in edgetree/runtime/reach.py, which says where the numbers
// come from.

const DISTANCE_STD = 0.015; // of a stem's distance, relative to the reach
const LEAST_READ = 0.3; // share of a stem's cells with a reading that tells its distance
const STEM = 0.5; // probability from which on a cell of a mask belongs to the stem

/** The share of a normal distribution below `z`: Abramowitz and Stegun 1964, formula 26.2.17. */
function below(z) {
  const t = 1 / (1 + 0.2316419 * Math.abs(z));
  const series =
    t * (0.31938153 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))));
  const tail = (Math.exp((-z * z) / 2) / Math.sqrt(2 * Math.PI)) * series;
  return z > 0 ? 1 - tail : tail;
}

/** Metres of a pixel; NaN without a reading, and off the picture. */
function metresAt({ width, height, depth }, x, y) {
  if (!(x >= 0 && x < width && y >= 0 && y < height)) return NaN;
  const value = depth[Math.floor(y) * width + Math.floor(x)];
  const metres = depth instanceof Uint16Array ? value / 1000 : value;
  return metres > 0 && metres < Infinity ? metres : NaN;
}

/** Distance in metres from the camera to a stem's axis at the lower end of its box; NaN if unknown. */
export function stemDistance({ box_px: [x0, y0, x1, y1], mask }, frame) {
  const size = Math.sqrt(mask.length);
  const isStem = (row, column) => mask[row * size + column] >= STEM;
  const columns = [...Array(size).keys()];
  const rows = columns.filter((row) => columns.some((column) => isStem(row, column)));
  if (!rows.length) return NaN;
  const middle = Math.floor((rows[0] + rows.at(-1) + 1) / 2);
  const lower = rows.filter((row) => row >= middle);
  const [cellX, cellY] = [(x1 - x0) / size, (y1 - y0) / size];
  const readings = [];
  let cells = 0;
  for (const row of lower)
    for (const column of columns) {
      if (!isStem(row, column)) continue;
      cells++;
      const metres = metresAt(frame, x0 + cellX * (column + 0.5), y0 + cellY * (row + 0.5));
      if (metres > 0) readings.push(metres);
    }
  if (readings.length < Math.max(LEAST_READ * cells, 1)) return NaN;
  readings.sort((a, b) => a - b);
  const { fx, fy, cx, cy } = frame.camera;
  const along = Math.hypot(((x0 + x1) / 2 - 0.5 - cx) / fx, (y1 - 0.5 - cy) / fy, 1);
  const stemWidth = (cells / lower.length) * cellX;
  return readings[(readings.length - 1) >> 1] * (along + (0.5 * stemWidth) / fx);
}

/**
 * The trees (see trees.js) with their scores times the chance that they stand within reach, without
 * those that fall below the threshold.
 *
 * All trees as they are if the frame has no camera or no depth in millimetres or metres, or if it is
 * not known how far trees were labelled.
 */
export function withinReach(trees, manifest, frame, scoreThreshold) {
  // For depth alone, a file may have a model of its own.
  const { reach_m: reach } = (!frame.colour && manifest.alone?.depth) || manifest;
  const depth = manifest.modality === "depth" ? frame.data : frame.depth;
  if (!reach || !frame.camera || !depth || depth instanceof Uint8Array) return trees;
  const scored = trees.map((tree) => {
    const distance = tree.mask ? stemDistance(tree, { ...frame, depth }) : NaN;
    if (Number.isNaN(distance)) return tree;
    return { ...tree, score: tree.score * below((reach - distance) / (DISTANCE_STD * reach)) };
  });
  return scored
    .filter(({ score }) => score >= scoreThreshold)
    .sort((a, b) => b.score - a.score);
}
