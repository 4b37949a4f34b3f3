// Serves the page: node serve.js MODEL.onnx [PORT]

import { createReadStream, statSync } from "node:fs";
import { createServer } from "node:http";
import path from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const HERE = path.dirname(fileURLToPath(import.meta.url));
const TYPES = {
  ".css": "text/css",
  ".html": "text/html; charset=utf-8",
  ".js": "text/javascript",
  ".json": "application/json",
  ".mjs": "text/javascript",
  ".wasm": "application/wasm",
};
// A browser lends threads to WebAssembly only if the page is isolated from others.
const ISOLATED = {
  "Cross-Origin-Opener-Policy": "same-origin",
  "Cross-Origin-Embedder-Policy": "require-corp",
};

/** A server on this machine; `folders` are further folders by the first part of their address. */
export function serve(model, port, folders = {}) {
  const roots = {
    page: path.join(HERE, "page"),
    js: path.join(HERE, "..", "js"),
    ort: path.join(HERE, "node_modules", "onnxruntime-web", "dist"),
    ...folders,
  };
  const fileOf = (address) => {
    if (address === "/") return path.join(roots.page, "index.html");
    if (address === "/model.onnx") return model;
    const [, top, ...rest] = address.split("/");
    const inside = rest.every((part) => part !== ".." && part !== "");
    return Object.hasOwn(roots, top) && inside ? path.join(roots[top], ...rest) : null;
  };
  const server = createServer((request, response) => {
    const file = fileOf(decodeURIComponent(new URL(request.url, "http://localhost").pathname));
    const size = file && statSync(file, { throwIfNoEntry: false })?.size;
    if (size === undefined || size === null) {
      response.writeHead(404).end("not found");
      return;
    }
    const type = TYPES[path.extname(file)] ?? "application/octet-stream";
    response.writeHead(200, { "Content-Type": type, "Content-Length": size, ...ISOLATED });
    createReadStream(file).pipe(response);
  });
  return new Promise((ready) => server.listen(port, "127.0.0.1", () => ready(server)));
}

if (import.meta.url === pathToFileURL(process.argv[1]).href) {
  const [model, port = "8080"] = process.argv.slice(2);
  if (!model) {
    console.error("usage: node serve.js MODEL.onnx [PORT]");
    process.exit(2);
  }
  await serve(model, Number(port));
  console.log(`http://localhost:${port}`);
}
