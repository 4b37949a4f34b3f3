// Opens a headless Chromium; the environment variable CHROMIUM names its program.

import { accessSync } from "node:fs";
import path from "node:path";

import { chromium } from "playwright-core";

const NAMES = ["chromium", "chromium-browser", "google-chrome"];

function onPath() {
  for (const folder of (process.env.PATH ?? "").split(path.delimiter)) {
    for (const name of NAMES) {
      const program = path.join(folder, name);
      try {
        accessSync(program);
        return program;
      } catch {
        continue;
      }
    }
  }
  throw new Error(`no ${NAMES.join(" or ")} on the path: expected one, or CHROMIUM=PROGRAM`);
}

export function openBrowser(args = []) {
  // Without a sandbox of its own, as containers forbid it; only our own page is opened.
  return chromium.launch({
    executablePath: process.env.CHROMIUM || onPath(),
    args: ["--no-sandbox", ...args],
  });
}
