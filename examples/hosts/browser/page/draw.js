// Draws trees on a canvas: masks, boxes, keypoints and numbers.

const COLOURS = ["#ffb000", "#4fc3f7", "#f06292", "#aed581", "#ba68c8", "#ff8a65", "#4db6ac"];
const AXIS = ["felling_cut", "axis_middle", "axis_top"];
const EDGES = ["diameter_left", "diameter_right"];

/** A mask as a picture of its grid, opaque where the probability is above one half. */
function maskPicture(mask, colour) {
  const size = Math.sqrt(mask.length);
  const grid = new OffscreenCanvas(size, size);
  const context = grid.getContext("2d");
  const [red, green, blue] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
  const cells = context.createImageData(size, size);
  mask.forEach((probability, index) => {
    const opacity = Math.min(1, Math.max(0, (probability - 0.5) * 4 + 0.5));
    cells.data.set([red, green, blue, opacity * 110], 4 * index);
  });
  context.putImageData(cells, 0, 0);
  return grid;
}

function line(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}

/** Draw the trees of `detect` on a canvas that shows their picture. */
export function drawTrees(canvas, trees, keypointNames) {
  const context = canvas.getContext("2d");
  const unit = Math.max(canvas.width, canvas.height) / 640;
  context.font = `bold ${13 * unit}px system-ui, sans-serif`;
  context.textBaseline = "bottom";
  trees.forEach((tree, index) => {
    const colour = COLOURS[index % COLOURS.length];
    const [x0, y0, x1, y1] = tree.box_px;
    if (tree.mask) context.drawImage(maskPicture(tree.mask, colour), x0, y0, x1 - x0, y1 - y0);
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 1.5 * unit;
    context.strokeRect(x0, y0, x1 - x0, y1 - y0);
    if (tree.keypoints_px) {
      const at = (names) => names.map((name) => tree.keypoints_px[keypointNames.indexOf(name)]);
      line(context, at(AXIS));
      line(context, at(EDGES));
      for (const [x, y] of tree.keypoints_px) {
        context.beginPath();
        context.arc(x, y, 2.5 * unit, 0, 2 * Math.PI);
        context.fill();
      }
    }
    const text = `${index + 1}`;
    const width = context.measureText(text).width + 6 * unit;
    const [left, bottom] = [Math.max(0, x0), Math.max(17 * unit, y0)];
    context.fillRect(left, bottom - 17 * unit, width, 17 * unit);
    context.fillStyle = "#000";
    context.fillText(text, left + 3 * unit, bottom - unit);
  });
}
