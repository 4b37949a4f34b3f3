// The button that marks, and what came of it.
class Marks {
  constructor(button, said) {
    this.button = button;
    this.said = said;
    this.failed = null; // number of recordings that failed, once it is known
    this.timer = null;
    button.addEventListener("click", () => this.mark());
  }
  // What the server says about recordings; null if recording is off.
  hear(recordings) {
    this.button.hidden = recordings === null;
    if (recordings === null) return;
    if (this.failed !== null && recordings.failed > this.failed) {
      this.say("A recording failed: look at what edgetree printed", true);
    }
    this.failed = recordings.failed;
  }
  async mark() {
    this.button.disabled = true;
    try {
      const answer = await fetch("mark", { method: "POST", body: "page", signal: AbortSignal.timeout(3000) });
      if (answer.ok) {
        const { kept_s } = await answer.json();
        this.say(`Marked: ${kept_s.toFixed(0)} s kept`, false);
      } else {
        this.say(`Not marked: ${(await answer.text()).replace(/^\d+ /, "").trim()}`, true);
      }
    } catch (error) {
      this.say("Not marked: no connection to edgetree", true);
    }
    this.button.disabled = false;
  }
  say(text, is_bad) {
    this.said.textContent = text;
    this.said.classList.toggle("bad", is_bad);
    this.said.hidden = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.said.hidden = true; }, is_bad ? 8000 : 4000);
  }
}

// The recordings in the bottom line.
function recordingsText(recordings) {
  if (recordings === null) return "";
  const count = `${recordings.written} recording${recordings.written === 1 ? "" : "s"}`;
  return recordings.is_recording ? `recording, ${count}` : count;
}

