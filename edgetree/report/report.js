"use strict";

// Units: every converted value is an element with data-quantity and data-value in metres, m³ or cm/m.
const units = JSON.parse(document.getElementById("units").textContent);
const unitButtons = document.querySelectorAll(".units button");

function showLengths(choice) {
  for (const element of document.querySelectorAll("[data-quantity]")) {
    const { quantity, value, std, bare } = element.dataset;
    const [unit, perMetre, digits] = units[choice][quantity];
    if (value === undefined) {
      element.textContent = unit;
      continue;
    }
    let text = (value * perMetre).toFixed(digits);
    if (std !== undefined) {
      text += ` ± ${Math.max(std * perMetre, 10 ** -digits).toFixed(digits)}`;
    }
    element.textContent = bare === undefined ? `${text} ${unit}` : text;
  }
  for (const button of unitButtons) {
    button.setAttribute("aria-pressed", String(button.value === choice));
  }
}

for (const button of unitButtons) {
  button.addEventListener("click", () => showLengths(button.value));
}

// Tables: a click on a column's head sorts by it; missing values stay at the end.
function compareCells(one, other, sign) {
  const oneMissing = one.classList.contains("none");
  const otherMissing = other.classList.contains("none");
  if (oneMissing || otherMissing) return oneMissing - otherMissing;
  if (one.dataset.value !== undefined) return sign * (one.dataset.value - other.dataset.value);
  return sign * one.textContent.localeCompare(other.textContent, "en", { numeric: true });
}

for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  for (const head of heads) {
    head.querySelector("button").addEventListener("click", () => {
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      const column = head.cellIndex;
      const rows = [...table.tBodies[0].rows];
      rows.sort((a, b) => compareCells(a.cells[column], b.cells[column], sign));
      table.tBodies[0].append(...rows);
    });
  }
}

// Pictures: Escape closes the enlarged one.
document.addEventListener("keydown", (event) => {
  if (event.key !== "Escape") return;
  for (const box of document.querySelectorAll("figure input:checked")) box.checked = false;
});
