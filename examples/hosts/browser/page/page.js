// The page: opens the model, finds trees in a picture or in the camera's frames, and draws them.

import { drawTrees } from "./draw.js";
import { openModel } from "./model.js";

const MOST_THREADS = 4;
const LONGEST_SIDE_PX = 1920;

const element = (id) => document.getElementById(id);
const [canvas, video, file, camera] = ["view", "video", "file", "camera"].map(element);
let detector = null;
let stream = null;
let queue = Promise.resolve(); // the network finds the trees of one frame at a time
let picture = null; // the last picture, to draw again for another score

function say(text, isError = false) {
  element("status").textContent = text;
  element("status").classList.toggle("error", isError);
}

/** The canvas's pixels as BGR. */
function frameOf(context) {
  const { width, height, data } = context.getImageData(0, 0, canvas.width, canvas.height);
  const bgr = new Uint8Array(width * height * 3);
  for (let from = 0, to = 0; from < data.length; from += 4, to += 3) {
    bgr[to] = data[from + 2];
    bgr[to + 1] = data[from + 1];
    bgr[to + 2] = data[from];
  }
  return { width, height, data: bgr };
}

function showTable(trees) {
  const cut = detector.manifest.keypoint_names.indexOf("felling_cut");
  const rows = trees.map((tree, index) => {
    const row = document.createElement("tr");
    const point = tree.keypoints_px?.[cut].slice(0, 2);
    const cells = [index + 1, tree.score.toFixed(2), tree.box_px.map(Math.round).join(", ")];
    for (const text of [...cells, point ? point.map(Math.round).join(", ") : ""])
      row.insertCell().textContent = text;
    return row;
  });
  element("trees").replaceChildren(...rows);
}

/** Find and draw the trees of an image, a video or a bitmap, after those that came before. */
function show(...source) {
  queue = queue.then(() => findAndDraw(...source)).catch((error) => say(error.message, true));
  return queue;
}

async function findAndDraw(source, width, height) {
  const shrink = Math.min(1, LONGEST_SIDE_PX / Math.max(width, height));
  canvas.width = Math.round(width * shrink);
  canvas.height = Math.round(height * shrink);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(source, 0, 0, canvas.width, canvas.height);
  const begin = performance.now();
  const trees = await detector.detect(frameOf(context), Number(element("score").value));
  const took = performance.now() - begin;
  drawTrees(canvas, trees, detector.manifest.keypoint_names);
  showTable(trees);
  say(`${trees.length} tree${trees.length === 1 ? "" : "s"} in ${took.toFixed(0)} ms`);
}

async function showPicture(blob) {
  try {
    picture = await createImageBitmap(blob);
  } catch {
    say(`${blob.name} is no picture that this browser reads`, true);
    return;
  }
  await show(picture, picture.width, picture.height);
}

async function showCamera() {
  while (stream) {
    await show(video, video.videoWidth, video.videoHeight);
    await new Promise(requestAnimationFrame);
  }
}

function stopCamera() {
  for (const track of stream?.getTracks() ?? []) track.stop();
  stream = null;
  camera.textContent = "Camera";
}

async function startCamera() {
  picture = null;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ video: { width: 1280, height: 720 } });
  } catch (error) {
    say(`the camera cannot be opened: ${error.message}`, true);
    return;
  }
  camera.textContent = "Stop";
  video.srcObject = stream;
  await video.play();
  await showCamera();
}

file.addEventListener("change", () => {
  stopCamera();
  if (file.files.length) showPicture(file.files[0]);
});
camera.addEventListener("click", () => (stream ? stopCamera() : startCamera()));
element("score").addEventListener("input", () => {
  element("score-text").textContent = Number(element("score").value).toFixed(2);
});
element("score").addEventListener("change", () => {
  if (picture) show(picture, picture.width, picture.height);
});

try {
  const response = await fetch("/model.onnx");
  if (!response.ok) throw new Error(`the server has no model (${response.status})`);
  const threads = Math.min(MOST_THREADS, navigator.hardwareConcurrency);
  detector = await openModel(new Uint8Array(await response.arrayBuffer()), threads);
  const { name, modality, precision, input } = detector.manifest;
  if (modality !== "rgb")
    throw new Error(`${name} takes ${modality} images: expected a model for colour pictures`);
  say(`${name}, ${precision}, ${input.width}x${input.height} px: choose a picture or the camera`);
  file.disabled = camera.disabled = false;
} catch (error) {
  say(`the model cannot be opened: ${error.message}`, true);
}
