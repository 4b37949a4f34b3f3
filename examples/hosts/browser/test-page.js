// Uses the page as a person would: node test-page.js MODEL.onnx PICTURE.jpg FOLDER
//
// Opens a picture and then a camera that shows it, writes a screenshot of each to FOLDER, and prints
// how many trees the page's table lists for both.

import { mkdir, mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import os from "node:os";
import path from "node:path";

import { openBrowser } from "./browser.js";
import { serve } from "./serve.js";

const [model, picture, folder] = process.argv.slice(2);
if (!folder) {
  console.error("usage: node test-page.js MODEL.onnx PICTURE.jpg FOLDER");
  process.exit(2);
}
await mkdir(folder, { recursive: true });
const temporary = await mkdtemp(path.join(os.tmpdir(), "edgetree-page-"));
const film = path.join(temporary, "camera.mjpeg"); // JPEG after JPEG
await writeFile(film, await readFile(picture));
const server = await serve(path.resolve(model), 0);
const browser = await openBrowser([
  "--use-fake-device-for-media-stream",
  "--use-fake-ui-for-media-stream",
  `--use-file-for-fake-video-capture=${film}`,
]);
try {
  const page = await browser.newPage({ viewport: { width: 1200, height: 1000 } });
  const errors = [];
  page.on("pageerror", (error) => errors.push(error.message));
  await page.goto(`http://localhost:${server.address().port}/`);
  const found = /\d+ trees? in \d+ ms/;
  const status = page.locator("#status");
  const trees = async (name) => {
    await status.filter({ hasText: found }).waitFor({ timeout: 60_000 });
    await page.screenshot({ path: path.join(folder, `${name}.png`), fullPage: true });
    return page.locator("#trees tr").count();
  };
  await page.locator("#camera:enabled, .error").first().waitFor({ timeout: 60_000 });
  if (await page.locator(".error").count()) throw new Error(await status.textContent());
  await page.setInputFiles("#file", picture);
  const inPicture = await trees("picture");
  await page.click("#camera");
  await page.locator("#camera", { hasText: "Stop" }).waitFor();
  await status.evaluate((element) => (element.textContent = "waiting"));
  const inCamera = await trees("camera");
  if (errors.length) throw new Error(errors.join("; "));
  console.log(JSON.stringify({ picture: inPicture, camera: inCamera }));
} finally {
  await browser.close();
  server.close();
  await rm(temporary, { recursive: true });
}
