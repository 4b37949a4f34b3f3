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

// Pictures are fetched one by one: a slow browser gets fewer, but none that waited in a buffer.
class Pictures {
  constructor(show) { this.show = show; this.stopper = null; this.serial = 0; }
  stop() { if (this.stopper) this.stopper.abort(); this.stopper = null; }
  async start() {
    this.stop();
    const { signal } = this.stopper = new AbortController();
    let showing = null; // the next picture is fetched while one is decoded
    while (!signal.aborted) {
      const next_ms = performance.now() + 100;
      let pause_ms = 0;
      try {
        const answer = await fetch(`picture.jpg?after=${this.serial}`, { signal, cache: "no-store" });
        if (answer.status === 200) {
          this.serial = Number(answer.headers.get("X-Serial"));
          const jpeg = await answer.blob();
          await showing;
          showing = this.show(jpeg, Number(answer.headers.get("X-Taken-S"))).catch(() => {});
        } else if (!answer.ok) {
          pause_ms = 1000;
        }
      } catch (error) {
        pause_ms = 1000;
      }
      await new Promise((resolve) => setTimeout(resolve, Math.max(pause_ms, next_ms - performance.now())));
    }
  }
}
