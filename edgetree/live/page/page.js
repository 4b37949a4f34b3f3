// The page: shows what is current, and blanks what is not.
const at = (id) => document.getElementById(id);
const clock = new Clock();
const marks = new Marks(at("mark"), at("said"));
const detail = new Detail(at("detail"), at("list"));
let record = null, status = null, heard_s = -Infinity, told = "", listed_s = 0;
let picture_taken_s = null;

const LOST_S = 1.5; // without a heartbeat for so long, the connection counts as lost

function seconds() { return performance.now() / 1000; }

function problem() {
  if (told !== "") return ["stale", "NO DATA", told];
  if (seconds() - heard_s > LOST_S) {
    return ["stale", "NO CONNECTION", "No connection to edgetree. Nothing here is current."];
  }
  if (status.state === "waiting") return ["waiting", "WAITING", "Waiting for the first frame."];
  const age = clock.age(status.taken_s);
  if (status.state === "stale" || age > status.stale_s) {
    return ["stale", "OLD", `No new frame for ${Math.max(age, 0).toFixed(0)} s. Blanked, because it is old.`];
  }
  return null;
}

function check() {
  const found = problem();
  const [kind, word] = found || ["live", "LIVE"];
  at("state").className = kind;
  at("state").textContent = word;
  blank(at("stems"), found && found[2]);
  blank(at("map"), found && found[2]);
  const picture = picture_taken_s === null ? Infinity : clock.age(picture_taken_s);
  const old = found === null && picture > status.stale_s;
  blank(at("view"), found ? found[2] : old ? "No current picture." : "");
  if (found || old) clearPicture();
  at("age").textContent = found || old ? "" : `picture ${Math.max(picture, 0).toFixed(2)} s old`;
  at("stages").textContent = found ? "" : stagesText();
}

function blank(section, text) {
  section.classList.toggle("blank", Boolean(text));
  section.querySelector(".cover").textContent = text || "";
}

function clearPicture() {
  const canvas = at("picture");
  canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  picture_taken_s = null;
}

function stagesText() {
  const stages = Object.entries(record.stages_ms).map(([name, ms]) => `${name} ${ms.toFixed(0)}`).join(", ");
  const age = Math.max(clock.age(record.taken_s), 0).toFixed(2);
  const rate = record.rate_hz === null ? "" : `${record.rate_hz.toFixed(1)} frames/s`;
  const times = stages === "" ? "" : `${stages} ms`;
  const recordings = recordingsText(status.recordings);
  return [rate, recordings, `stems ${age} s old`, times, `${record.dropped} frames left out`].filter(Boolean).join("  ·  ");
}

// Stems
function element(tag, name, text) {
  const made = document.createElement(tag);
  made.className = name;
  made.textContent = text;
  return made;
}

function centimetres(value, std, digits) {
  const least = 10 ** -digits;
  return [(value * 100).toFixed(digits), Math.max(std * 100, least).toFixed(digits)];
}

// A value with its standard deviation, or a dash.
function amount(stem, name, digits, failed) {
  const metres = stem[`${name}_m`];
  if (metres === undefined) return element("div", `${name} none`, failed);
  const wide = stem[`${name}_std_m`] >= 0.0995; // tenths of it say nothing
  const [value, std] = centimetres(metres, stem[`${name}_std_m`], wide ? 0 : digits);
  const made = element("div", name, value);
  made.append(element("small", "", ` ± ${std}`));
  return made;
}

function noteOf(stem) {
  const place = `${stem.distance_m.toFixed(1)} m away`;
  if (stem.warnings.length > 0) return element("div", "note warn", `⚠ ${place}, ${stem.warnings.join("; ")}`);
  const views = `${stem.views} view${stem.views === 1 ? "" : "s"}`;
  const parts = [place];
  if (!stem.in_view) parts.push(`not in view for ${stem.unseen_s.toFixed(0)} s`);
  if (stem.state === "new") parts.push("new");
  if (stem.diameter_m === undefined) parts.push(stem.diameter_failure);
  parts.push(stem.more_views_help ? `${views}, more will help` : views);
  return element("div", "note", parts.join(", "));
}

function rowOf(stem) {
  const row = element("li", stem.in_view ? "" : "unseen", "");
  row.dataset.number = stem.number;
  const number = element("div", stem.number > 999 ? "number long" : "number", stem.number);
  number.style.background = stem.colour;
  row.append(number, amount(stem, "diameter", 1, "no diameter"), amount(stem, "cut_height", 0, "–"), noteOf(stem));
  return row;
}

function showStems() {
  const list = at("list"), stems = record.stems;
  const seen = stems.filter((stem) => stem.in_view).length;
  const room = Math.max(1, Math.floor(list.clientHeight / rowHeight(list)));
  list.replaceChildren(...stems.slice(0, room).map(rowOf));
  const parts = [`${seen} of ${stems.length} in view`];
  if (stems.length > room) parts.push(`${stems.length - room} not listed`);
  const warned = stems.some((stem) => stem.warnings.length > 0);
  const last = warned ? "⚠: touch it." : "± 1 std. dev.";
  at("more").textContent = record.metres_need || `${parts.join(", ")}. ${last}`;
  detail.show(stems);
}

function rowHeight(list) {
  const probe = list.appendChild(element("li", "", ""));
  const height = probe.getBoundingClientRect().height;
  probe.remove();
  return height;
}

// Streams
async function showPicture(jpeg, taken_s) {
  const bitmap = await createImageBitmap(jpeg);
  const canvas = at("picture");
  if (canvas.width !== bitmap.width) canvas.width = bitmap.width;
  if (canvas.height !== bitmap.height) canvas.height = bitmap.height;
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  bitmap.close();
  picture_taken_s = taken_s;
  check();
}

function hear(event) {
  status = JSON.parse(event.data);
  clock.hear(status.clock_s);
  heard_s = seconds();
  marks.hear(status.recordings);
  if (event.type === "stems") {
    record = status;
    if (heard_s - listed_s > 0.19) { // numbers that change faster cannot be read
      listed_s = heard_s;
      showStems();
      drawPlan(at("plan"), record);
    }
  }
  check();
}

let events = null;
const pictures = new Pictures(showPicture);

function openEvents() {
  events = new EventSource("events");
  events.addEventListener("open", () => { // of a server that may have another clock
    clock.reset();
    heard_s = -Infinity;
    picture_taken_s = null;
    pictures.serial = 0;
    told = "";
  });
  events.addEventListener("stems", hear);
  events.addEventListener("beat", hear);
  events.addEventListener("error", () => {
    const failed = events;
    if (failed.readyState !== EventSource.CLOSED) return;
    askWhy();
    setTimeout(() => { if (events === failed) openEvents(); }, 2000);
  });
}

// Why the server refuses the events; an EventSource does not tell.
async function askWhy() {
  try {
    const answer = await fetch("events", { cache: "no-store" });
    told = answer.ok ? "" : (await answer.text()).replace(/^\d+ /, "").trim();
    if (answer.ok) await answer.body.cancel();
  } catch (error) {
    told = "";
  }
  check();
}

function close() {
  if (events !== null) events.close();
  events = null;
  pictures.stop();
}

// A page that is not looked at takes no time of the machine.
function follow() {
  close();
  check();
  if (document.hidden) return;
  openEvents();
  pictures.start();
}

// Theme
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  at("theme").textContent = theme === "night" ? "Day" : "Night";
  try { localStorage.setItem("edgetree-theme", theme); } catch (error) { /* not kept */ }
  if (record !== null) drawPlan(at("plan"), record);
}

function firstTheme() {
  let kept = null;
  try { kept = localStorage.getItem("edgetree-theme"); } catch (error) { /* none */ }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  return kept === "night" || kept === "day" ? kept : dark ? "night" : "day";
}

at("theme").addEventListener("click", () => {
  setTheme(document.documentElement.dataset.theme === "night" ? "day" : "night");
});
if (location.search !== "") history.replaceState(null, "", location.pathname); // the token
setTheme(firstTheme());
setInterval(check, 200);
document.addEventListener("visibilitychange", follow);
window.addEventListener("resize", () => { if (record !== null) { drawPlan(at("plan"), record); showStems(); } });
follow();
