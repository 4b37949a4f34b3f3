// Finds the trees of a conformance kit in Chromium: node run-kit.js KIT RESULTS.json [THREADS] [ROUNDS]
//
// CHROMIUM names the browser's program; "chromium" of the path if not given.

import { readFile, writeFile } from "node:fs/promises";
import path from "node:path";

import { openBrowser } from "./browser.js";
import { serve } from "./serve.js";

const [folder, out, threads = "2", rounds = "0"] = process.argv.slice(2);
if (!out) {
  console.error("usage: node run-kit.js KIT RESULTS.json [THREADS] [ROUNDS]");
  process.exit(2);
}
const kit = JSON.parse(await readFile(path.join(folder, "kit.json"), "utf8"));
const server = await serve(path.join(folder, kit.model), 0, { kit: path.resolve(folder) });
const browser = await openBrowser();
try {
  const page = await browser.newPage();
  await page.goto(`http://localhost:${server.address().port}/page/kit.html`);
  const about = {
    host: "examples/hosts/browser",
    processor: "wasm",
    threads: Number(threads),
  };
  const results = await page.evaluate(
    ([about, rounds]) => window.findTreesOfKit(about, rounds),
    [about, Number(rounds)],
  );
  await writeFile(out, JSON.stringify(results));
} finally {
  await browser.close();
  server.close();
}
