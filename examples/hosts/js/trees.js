// From the model's outputs to the trees of a frame, as the manifest says.

const INSIDE = 0.5; // probability above which a cell of a mask belongs to the tree
const MASK_OVERLAP = 0.8; // for older files, whose manifest does not say it

/** Which cell of a box's grid a coordinate lies in; it may be outside. */
const cell = (at, low, high, size) => Math.floor(((at - low) / (high - low)) * size);

/** Common cells of two masks, as a share of the smaller one's. */
function overlap(a, b, size) {
  const area = (tree) =>
    tree.inside * (tree.box[2] - tree.box[0]) * (tree.box[3] - tree.box[1]);
  const [small, large] = area(a) < area(b) ? [a, b] : [b, a];
  const [x0, y0, x1, y1] = small.box;
  const [left, top, right, bottom] = large.box;
  let common = 0;
  for (let row = 0; row < size; row++) {
    const r = cell(y0 + ((row + 0.5) * (y1 - y0)) / size, top, bottom, size);
    if (r < 0 || r >= size) continue;
    for (let column = 0; column < size; column++) {
      if (!(small.mask[row * size + column] > INSIDE)) continue;
      const c = cell(x0 + ((column + 0.5) * (x1 - x0)) / size, left, right, size);
      if (c >= 0 && c < size && large.mask[r * size + c] > INSIDE) common++;
    }
  }
  return common / Math.max(small.inside, 1);
}

const touch = ([a0, b0, a1, b1], [c0, d0, c1, d1]) =>
  Math.min(a1, c1) > Math.max(a0, c0) && Math.min(b1, d1) > Math.max(b0, d0);

/** Of trees whose masks cover each other, only the one with the highest score, which comes first. */
function distinct(trees, size, most) {
  const kept = [];
  for (const tree of trees) {
    tree.inside = tree.mask.reduce((sum, value) => sum + (value > INSIDE), 0);
    const covers = (other) => touch(tree.box, other.box) && overlap(other, tree, size) > most;
    if (!kept.some(covers)) kept.push(tree);
  }
  return kept;
}

/**
 * The trees in a frame, in its pixels, by descending score.
 *
 * `outputs` are the model's tensors by name, `box` is the letterbox, `frame` has width and height.
 */
export function treesOf(outputs, manifest, box, frame, scoreThreshold) {
  const { scores, boxes, keypoints, masks } = outputs;
  const count = Number(outputs.num_detections.data[0]);
  const row = (tensor, index) => {
    const length = tensor.dims.slice(2).reduce((product, size) => product * size, 1);
    return tensor.data.subarray(index * length, (index + 1) * length);
  };
  let found = [];
  for (let index = 0; index < count; index++) {
    const rectangle = row(boxes, index);
    const inView = rectangle[0] / box.scaleX < frame.width && rectangle[1] / box.scaleY < frame.height;
    if (!inView || !(scores.data[index] >= scoreThreshold)) continue;
    found.push({
      score: Math.min(1, scores.data[index]),
      box: rectangle,
      points: keypoints && row(keypoints, index),
      mask: masks && row(masks, index),
    });
  }
  if (masks) found = distinct(found, masks.dims[2], manifest.thresholds.mask_overlap ?? MASK_OVERLAP);
  return found.map(({ score, box: sides, points, mask }) => ({
    score,
    box_px: Array.from(sides, (value, i) => value / (i % 2 ? box.scaleY : box.scaleX)),
    keypoints_px: points
      ? manifest.keypoint_names.map((_, i) => [
          points[3 * i] / box.scaleX,
          points[3 * i + 1] / box.scaleY,
          points[3 * i + 2],
        ])
      : null,
    mask: mask ? Array.from(mask) : null,
  }));
}
