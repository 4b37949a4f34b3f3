"use strict";

// Clock: the smallest difference to the machine's clock within the last 10 to 20 s has the least
// delay in it. Two halves, so that the clocks may drift apart.
class Clock {
  constructor() { this.reset(); }
  reset() { this.best = Infinity; this.next = Infinity; this.turn = 0; }
  hear(clock_s) {
    const now = performance.now() / 1000;
    if (now - this.turn > 10) { this.best = this.next; this.next = Infinity; this.turn = now; }
    this.next = Math.min(this.next, now - clock_s);
    this.best = Math.min(this.best, this.next);
  }
  age(taken_s) { return performance.now() / 1000 - this.best - taken_s; }
}

// Pictures: reads multipart/x-mixed-replace itself, to know which frame each picture shows.
class PictureStream {
  constructor(show, fail) { this.show = show; this.fail = fail; this.stopper = null; }
  stop() { if (this.stopper) this.stopper.abort(); this.stopper = null; }
  async start() {
    this.stop();
    const stopper = this.stopper = new AbortController();
    while (!stopper.signal.aborted) {
      try {
        const answer = await fetch("picture.mjpeg", { signal: stopper.signal, cache: "no-store" });
        if (!answer.ok) {
          this.fail((await answer.text()).replace(/^\d+ /, "").trim());
        } else {
          this.fail("");
          await this.read(answer.body.getReader());
        }
      } catch (error) {
        if (stopper.signal.aborted) return;
        this.fail(""); // the events tell that the connection is lost
      }
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }
  async read(reader) {
    let held = new Uint8Array(0);
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      const joined = new Uint8Array(held.length + value.length);
      joined.set(held); joined.set(value, held.length);
      held = this.parts(joined);
    }
  }
  // Show the last complete part; return what is left.
  parts(bytes) {
    let newest = null;
    for (;;) {
      const end = headEnd(bytes);
      if (end < 0) break;
      const head = new TextDecoder("latin1").decode(bytes.subarray(0, end));
      const length = Number(field(head, "Content-Length"));
      if (bytes.length < end + length + 2) break;
      newest = { head, jpeg: bytes.slice(end, end + length) };
      bytes = bytes.slice(end + length + 2);
    }
    if (newest !== null && field(newest.head, "X-Serial") !== null) {
      this.show(newest.jpeg, Number(field(newest.head, "X-Taken-S")));
    }
    return bytes;
  }
}

function headEnd(bytes) {
  for (let i = 3; i < Math.min(bytes.length, 2000); i += 1) {
    if (bytes[i] === 10 && bytes[i - 1] === 13 && bytes[i - 2] === 10 && bytes[i - 3] === 13) return i + 1;
  }
  return -1;
}

function field(head, name) {
  const found = head.match(new RegExp(`^${name}: (.*)$`, "im"));
  return found === null ? null : found[1].trim();
}
