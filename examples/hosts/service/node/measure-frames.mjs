// Hands raw frames over to the service and prints the answers: measure-frames.mjs ADDRESS FRAMES
//
// FRAMES is what raw_frames.py writes, in place of a camera. Pixels go beside the JSON text.

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { Dealer } from "zeromq";

const [address, folder] = process.argv.slice(2);
const socket = new Dealer({ linger: 500, receiveTimeout: 60_000, sendTimeout: 60_000 });
socket.connect(address);
const lines = readFileSync(join(folder, "frames.txt"), "utf8").trim().split("\n");
for (const [id, line] of lines.entries()) {
  const [name, ...texts] = line.split(" ");
  const [time_s, width, height, fx, fy, cx, cy, ...rest] = texts.map(Number);
  const rotation = [rest.slice(3, 6), rest.slice(6, 9), rest.slice(9, 12)];
  const message = {
    schema: "edgetree.serve.frame/1",
    id,
    time_s,
    colour: { width, height, format: "bgr8" },
    depth: { width, height, format: "float32", scale_m: 1.0 },
    camera: { width, height, fx, fy, cx, cy },
    up_camera: rest.slice(0, 3),
    pose: { rotation, translation_m: rest.slice(12, 15) },
  };
  const pixels = ["bgr", "depth"].map((kind) => readFileSync(join(folder, `${name}.${kind}`)));
  await socket.send([JSON.stringify(message), ...pixels]);
  let answer;
  do {
    answer = String(await socket.receive());
  } while (JSON.parse(answer).id !== id); // a status may come unasked
  console.log(answer);
}
await socket.send(JSON.stringify({ schema: "edgetree.serve.bye/1" }));
socket.close();
