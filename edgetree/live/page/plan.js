// Plan view from above: the camera at the bottom, rings every 2 m, stems to scale.
function drawPlan(canvas, record) {
  const box = canvas.getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(box.width * ratio);
  canvas.height = Math.round(box.height * ratio);
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  const style = getComputedStyle(document.documentElement);
  const ink = (name) => style.getPropertyValue(name).trim();
  const text = Math.max(13, Math.min(20, box.width / 28));
  const far = planRange(record.stems);
  const foot = text * 0.7;
  const perMetre = (box.height - foot - text * 0.6) / far;
  const x0 = box.width / 2, y0 = box.height - foot;
  const place = ([right, ahead]) => [x0 + right * perMetre, y0 - ahead * perMetre];

  pen.font = `600 ${text * 0.85}px system-ui, sans-serif`;
  drawRings(pen, { x0, y0, far, perMetre, text, width: box.width }, ink);
  drawField(pen, { x0, y0, far, perMetre }, record.field_of_view_deg, ink);
  pen.fillStyle = ink("--ink");
  pen.beginPath();
  pen.moveTo(x0, y0 - foot); pen.lineTo(x0 - foot * 0.8, y0 + foot * 0.6);
  pen.lineTo(x0 + foot * 0.8, y0 + foot * 0.6); pen.fill();
  for (const stem of [...record.stems].reverse()) drawStem(pen, stem, place(stem.plan_m), perMetre, text, ink);
}

// Range of the plan: steps, so that it does not change all the time.
function planRange(stems) {
  const ahead = stems.filter((stem) => stem.in_view).map((stem) => stem.plan_m[1]);
  const needed = Math.max(0, ...ahead) + 0.5;
  return [6, 8, 10, 12, 16, 20].find((range) => range >= needed) || 24;
}

function drawRings(pen, { x0, y0, far, perMetre, text, width }, ink) {
  pen.lineWidth = 1;
  pen.strokeStyle = ink("--grid");
  pen.fillStyle = ink("--soft");
  pen.textAlign = "center";
  const step = [2, 4, 8].find((metres) => metres * perMetre > text * 2.6) || 16;
  for (let range = 2; range <= far; range += 2) {
    pen.beginPath();
    pen.arc(x0, y0, range * perMetre, Math.PI, 2 * Math.PI);
    pen.stroke();
    const x = x0 + range * perMetre;
    if (range % step === 0 && x < width) pen.fillText(`${range} m`, x - text, y0 + text * 0.4);
  }
}

function drawField(pen, { x0, y0, far, perMetre }, edges, ink) {
  if (edges === null) return;
  pen.strokeStyle = ink("--soft");
  pen.setLineDash([6, 5]);
  for (const edge of edges) {
    const angle = edge * Math.PI / 180, reach = far * perMetre;
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.lineTo(x0 + reach * Math.sin(angle), y0 - reach * Math.cos(angle));
    pen.stroke();
  }
  pen.setLineDash([]);
}

function drawStem(pen, stem, [x, y], perMetre, text, ink) {
  const radius = Math.max(3, (stem.diameter_m || 0.1) / 2 * perMetre);
  const spread = radius + 2 * stem.plan_std_m * perMetre;
  pen.lineWidth = 1.5;
  pen.strokeStyle = ink("--ink");
  pen.setLineDash([3, 3]);
  pen.beginPath(); pen.arc(x, y, spread, 0, 2 * Math.PI); pen.stroke();
  pen.setLineDash([]);
  pen.fillStyle = stem.in_view ? stem.colour : ink("--card");
  pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); pen.fill(); pen.stroke();
  pen.font = `700 ${text}px system-ui, sans-serif`;
  pen.textAlign = "left";
  pen.lineWidth = 3;
  pen.strokeStyle = ink("--card");
  pen.fillStyle = stem.in_view ? ink("--ink") : ink("--soft");
  const label = [`${stem.number}`, x + spread + 3, y + text * 0.35];
  pen.strokeText(...label); pen.fillText(...label);
}
