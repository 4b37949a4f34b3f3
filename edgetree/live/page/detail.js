// All that is known of one stem, over the plan, with its warnings in full. A touch on a row or the
// arrow keys choose the stem; the rows themselves are made anew too often to hold the focus.
class Detail {
  constructor(box, list) {
    this.box = box;
    this.number = null;
    this.stems = [];
    list.addEventListener("pointerdown", (event) => {
      const row = event.target.closest("li");
      if (row !== null) this.choose(Number(row.dataset.number));
    });
    list.addEventListener("keydown", (event) => this.key(event));
    box.addEventListener("click", () => this.choose(null));
  }
  choose(number) {
    this.number = number === this.number ? null : number;
    this.show(this.stems);
  }
  key(event) {
    const steps = { ArrowDown: 1, ArrowUp: -1 };
    if (event.key === "Escape") this.choose(null);
    if (!(event.key in steps) || this.stems.length === 0) return;
    event.preventDefault();
    const at = this.stems.findIndex((stem) => stem.number === this.number);
    const next = at < 0 ? 0 : Math.min(Math.max(at + steps[event.key], 0), this.stems.length - 1);
    if (this.stems[next].number !== this.number) this.choose(this.stems[next].number);
  }
  show(stems) {
    this.stems = stems;
    for (const row of document.querySelectorAll("#list li")) {
      row.classList.toggle("chosen", Number(row.dataset.number) === this.number);
    }
    const stem = stems.find((each) => each.number === this.number);
    this.box.hidden = stem === undefined;
    if (stem === undefined) return;
    const warnings = stem.warnings.map((text) => element("li", "warning", `⚠ ${text}`));
    const facts = factsOf(stem).map((text) => element("li", "", text));
    if (warnings.length === 0) warnings.push(element("li", "", "No warnings."));
    const lines = document.createElement("ul");
    lines.append(...warnings, ...facts);
    this.box.replaceChildren(element("h3", "", `Stem ${stem.number}`), lines);
  }
}

function factsOf(stem) {
  const said = (words, name, factor, digits, unit) => {
    const value = stem[`${name}`];
    if (value === undefined) return null;
    const std = stem[name.replace(/_(m|deg)$/, "_std_$1")];
    return `${words} ${(value * factor).toFixed(digits)} ± ${(std * factor).toFixed(digits)} ${unit}`;
  };
  const why = stem.diameter_m === undefined ? `No diameter: ${stem.diameter_failure}` : null;
  return [
    why,
    said("Diameter", "diameter_m", 100, 1, "cm"),
    said("At breast height", "dbh_m", 100, 1, "cm"),
    said("Cut height", "cut_height_m", 100, 0, "cm"),
    said("Lean", "inclination_deg", 1, 1, "°"),
    `${stem.distance_m.toFixed(1)} m away, ${stem.views} distinct view${stem.views === 1 ? "" : "s"}`,
  ].filter((text) => text !== null);
}
