"use strict";
const $ = id => document.getElementById(id);
const SHAPES = { follow: "●", assist: "▲", wait: "◆", fault: "■", silent: "?" };
const OLD_MS = 1000, AGAIN_MS = 500;
let about = {}, socket = null, cameAt = 0, pressedAt = -1e9, playing = null, asking = false, wanted = null;

function set(id, text) { const node = $(id); if (node.textContent !== text) node.textContent = text; }
function shown(value, unit, digits = 0) { return value === null || value === undefined ? "not known" : value.toFixed(digits) + unit; }
function list(id, rows) {
  const key = JSON.stringify(rows), node = $(id);
  if (node.dataset.key === key) return;
  node.dataset.key = key;
  node.replaceChildren(...rows.flatMap(([name, value, bad]) => {
    const dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = name; dd.textContent = value; if (bad) dd.className = "bad";
    return [dt, dd];
  }));
}

function showState(state) {
  const name = state.verb ? state.word + " " + state.verb : state.word;
  if ($("state").className !== state.kind) $("state").className = state.kind;
  set("shape", SHAPES[state.kind] || "?"); set("name", name); set("reason", state.reason); set("cure", state.cure);
  set("for", typeof state.for_s === "number" ? "For " + state.for_s.toFixed(1) + " s." : "");
  set("spoken", name + ". " + state.reason + (state.cure ? " " + state.cure : ""));
  document.title = name + " - Monitor";
}

function lost(why) {
  showState({ word: "NO CONNECTION", verb: null, kind: "silent", reason: why, cure: "What stands below is old. Use the device's own stop." });
}

function showChart(confidence) {
  const y = value => (145 - 140 * value).toFixed(1), x = s => (600 + 20 * s).toFixed(1);
  $("trace").setAttribute("points", confidence.trace.map(([s, value]) => x(s) + "," + y(value)).join(" "));
  const acts = confidence.trace.filter(point => point[2]).map(([s]) => {
    const bar = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    for (const [name, value] of Object.entries({ class: "act", x: x(s), y: 138, width: 3, height: 12 })) bar.setAttribute(name, value);
    return bar;
  });
  $("acts").replaceChildren(...acts);
  for (const [id, tau, word] of [["on", confidence.tau_on, "acts from "], ["off", confidence.tau_off, "holds below "]]) {
    const there = tau === null ? "hidden" : "visible";
    $(id).setAttribute("visibility", there); $(id + "-text").setAttribute("visibility", there);
    if (tau === null) continue;
    $(id).setAttribute("y1", y(tau)); $(id).setAttribute("y2", y(tau));
    $(id + "-text").setAttribute("y", id === "on" ? y(tau) - 4 : Number(y(tau)) + 15);
    $(id + "-text").textContent = word + Number((100 * tau).toPrecision(3)) + " %";
  }
  set("confidence-now", confidence.now === null ? "not known" : (100 * confidence.now).toFixed(0) + " %");
  set("thresholds", confidence.tau_on === null
    ? "The thresholds are not known: the bridge uses another bundle; name it with --bundle. Bars below: ACT."
    : "Last 30 s. Bars below the line: ACT.");
}

function showLists(view) {
  const sensors = view.sensors;
  list("sensors", [
    ...Object.entries(sensors.valid).map(([name, ok]) => [name, ok === null ? "? not known" : ok ? "✓ well" : "✕ not used", ok === false]),
    ["oldest input", sensors.age_ms === null ? "not known" : sensors.age_ms + " ms of " + sensors.limit_ms + " ms", sensors.age_ms !== null && sensors.age_ms > sensors.limit_ms],
  ]);
  const arm = view.device;
  list("device", arm.joint === undefined ? [["measurements", "none"]] : [
    ["assist", shown(arm.assist_nm, " N m", 2)], ["gravity support", shown(arm.gravity_nm, " N m", 2)],
    [arm.joint.toLowerCase() + " angle", shown(arm.angle_deg, "°", 1)], ["velocity", shown(arm.velocity_deg_s, "°/s")],
    ["authority", shown(arm.authority, " %")], ["session", arm.armed ? "armed (" + arm.session + ")" : "none"],
  ]);
  const bus = view.bus, errors = bus.tx_errors === null ? "" : " (TEC " + bus.tx_errors + ", REC " + bus.rx_errors + ")";
  list("bus", [
    ["link", bus.up ? "✓ up" : "✕ down " + bus.reason, !bus.up], ["load", (100 * bus.load).toFixed(0) + " % (" + bus.frames_s + " frames/s)"],
    ["controller", bus.controller + errors], ["lost by this page", String(bus.lost), bus.lost > 0],
    ...Object.entries(bus.rejected).map(([name, count]) => [name, String(count), true]),
    ...Object.entries(bus.counters).slice(0, 8).map(([name, count]) => [name, String(count)]),
  ]);
  set("verbs-of", "(" + view.verbs.of + ")");
  const key = JSON.stringify(view.verbs.top);
  if ($("verbs").dataset.key !== key) {
    $("verbs").dataset.key = key;
    const rows = view.verbs.top.length ? view.verbs.top : [["none", null]];
    $("verbs").replaceChildren(...rows.map(([verb, share]) => {
      const row = document.createElement("tr"), name = row.insertCell(), figure = row.insertCell();
      name.textContent = verb; figure.className = "share"; figure.textContent = share === null ? "" : (100 * share).toFixed(0) + " %";
      return row;
    }));
  }
}

function showEvents(events) {
  const key = events.length + "|" + (events[0] || "");
  if ($("events").dataset.key === key) return;
  $("events").dataset.key = key;
  $("events").replaceChildren(...events.map(([s, text]) => {
    const item = document.createElement("li"), when = document.createElement("time"), what = document.createElement("span");
    when.textContent = s.toFixed(1) + " s"; what.textContent = text; item.append(when, what);
    return item;
  }));
}

function show(view) {
  if (!view.state) return;
  cameAt = performance.now();
  showState(view.state); showChart(view.confidence); showLists(view); showEvents(view.events);
  set("clock", view.s.toFixed(1) + " s");
  if (about.live) {
    const own = view.bundle_id === about.bundle_id;
    set("card-doubt", view.bundle_id === null ? "The bridge has not named its bundle." : own ? "" :
      "The bridge uses bundle " + view.bundle_id.toString(16).padStart(4, "0") + "; name its file with --bundle.");
    $("card").hidden = !own && view.bundle_id !== null;
  }
}

// A circle, a square and points, each with its word, in a light line on a dark one: seen on any picture, by any colour vision.
function drawOver(seen) {
  const svg = $("overlay"), w = seen.width, h = seen.height, r = w / 30, line = w / 160;
  const part = (name, attributes) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    return node;
  };
  const twice = (name, kind, place) => [
    part(name, { class: "under", "stroke-width": 2.4 * line, ...place }), part(name, { class: kind, "stroke-width": line, ...place })];
  const word = (text, x, y) => {
    const node = part("text", { class: "name", x, y, "font-size": w / 26, "stroke-width": line });
    node.textContent = text;
    return node;
  };
  const nodes = [];
  for (const hand of seen.hands) {
    const [x, y] = [hand[0] * w, hand[1] * h];
    for (let k = 2; k + 1 < hand.length; k += 2) nodes.push(part("circle", { class: "point", "stroke-width": line / 3, cx: hand[k] * w, cy: hand[k + 1] * h, r: line * 1.3 }));
    nodes.push(...twice("rect", "hand", { x: x - r, y: y - r, width: 2 * r, height: 2 * r }), word("hand", x + 1.3 * r, y + r / 2));
  }
  if (seen.gaze) {
    const [x, y] = [seen.gaze[0] * w, seen.gaze[1] * h];
    nodes.push(...twice("circle", "gaze", { cx: x, cy: y, r }), word("gaze", x + 1.3 * r, y - r / 2));
  }
  svg.setAttribute("viewBox", "0 0 " + w + " " + h);
  const hands = seen.hands.length + (seen.hands.length === 1 ? " hand" : " hands");
  const label = (seen.gaze ? "Gaze" : "No gaze") + " and " + hands + " in the picture";
  if (svg.getAttribute("aria-label") !== label) svg.setAttribute("aria-label", label);
  svg.replaceChildren(...nodes);
}

// On a canvas: browsers keep decoded pictures of an <img> for long, and twenty a second fill memory.
async function showPicture(blob, seen) {
  const bitmap = await createImageBitmap(blob), picture = $("picture");
  if (picture.width !== bitmap.width || picture.height !== bitmap.height) { picture.width = bitmap.width; picture.height = bitmap.height; }
  picture.getContext("2d").drawImage(bitmap, 0, 0);
  bitmap.close();
  drawOver(seen);
}

async function followPictures() {
  let number = "0", pictureAt = -1e9;
  for (;;) {
    const began = performance.now();
    try {
      if (!document.hidden) {
        const answer = await fetch("picture?after=" + number);
        if (answer.status === 200) {
          const seen = JSON.parse(answer.headers.get("X-Overlay"));
          number = seen.number; pictureAt = began;
          await showPicture(await answer.blob(), seen);
        }
      }
    } catch { /* the state above says that there is no connection */ }
    const shown = performance.now() - pictureAt < 2 * OLD_MS;
    if ($("picture-part").hidden === shown) $("picture-part").hidden = !shown;
    await new Promise(done => setTimeout(done, Math.max(20, (shown ? 100 : 1000) - (performance.now() - began))));
  }
}

function connect() {
  const address = new URL("live", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(address);
  socket.onmessage = message => {
    const told = JSON.parse(message.data);
    if ("stop" in told) set("stop-said", told.stop === "" ? "STOP sent three times." : told.stop + ". Use the device's own stop.");
    else show(told);
  };
  socket.onclose = () => { lost("The monitor does not answer."); setTimeout(connect, AGAIN_MS); };
}

function stop() {
  const open = socket !== null && socket.readyState === WebSocket.OPEN;
  if (open) socket.send("STOP");  // before anything is drawn
  set("stop-said", open ? "" : "STOP was NOT sent: no connection. Use the device's own stop.");
}

function startLive() {
  if (about.can_stop) {
    $("stop").hidden = $("stop-hint").hidden = false;
    $("stop").addEventListener("pointerdown", () => { pressedAt = performance.now(); stop(); });
    $("stop").addEventListener("click", () => { if (performance.now() - pressedAt > 1000) stop(); });
    document.addEventListener("keydown", event => { if (event.key === "Escape" && !event.repeat) stop(); });
  }
  connect();
  set("picture-says", "Shared by the bridge on this computer; this page keeps none. Whoever is in it should know.");
  followPictures();
  setInterval(() => { if (socket.readyState === WebSocket.OPEN && performance.now() - cameAt > OLD_MS) lost("No view has come for a second."); }, 250);
}

async function moment(s) {
  wanted = s;
  set("now", s.toFixed(2) + " s");
  if (asking) return;
  asking = true;
  try {
    while (wanted !== null) {
      const at = wanted; wanted = null;
      const [view, picture] = await Promise.all([fetch("view?s=" + at), fetch("picture?s=" + at)]);
      show(await view.json());
      $("picture-part").hidden = picture.status !== 200;
      if (picture.status === 200) await showPicture(await picture.blob(), JSON.parse(picture.headers.get("X-Overlay")));
    }
  } catch { lost("The monitor does not answer."); } finally { asking = false; }
}

function startRecorded() {
  const slider = $("at");
  $("time").hidden = false; slider.max = about.length_s;
  slider.addEventListener("input", () => moment(Number(slider.value)));
  $("play").addEventListener("click", () => {
    if (playing !== null) { clearInterval(playing); playing = null; set("play", "Play"); return; }
    const from = Number(slider.value) >= about.length_s ? 0 : Number(slider.value), began = performance.now();
    set("play", "Pause");
    playing = setInterval(() => {
      slider.value = Math.min(about.length_s, from + (performance.now() - began) / 1000);
      moment(Number(slider.value));
      if (Number(slider.value) >= about.length_s) $("play").click();
    }, 200);
  });
  moment(0);
}

async function start() {
  for (const s of [0, 25, 50, 75, 100]) {
    const rule = document.createElementNS("http://www.w3.org/2000/svg", "line");
    const y = 145 - 1.4 * s;
    for (const [name, value] of Object.entries({ class: "rule", x1: 0, x2: 600, y1: y, y2: y })) rule.setAttribute(name, value);
    $("grid").append(rule);
  }
  try { about = await (await fetch("about")).json(); }
  catch { lost("The monitor does not answer."); setTimeout(start, AGAIN_MS); return; }
  set("title", "Monitor of " + about.title);
  list("card", about.card);
  document.querySelector("main").classList.toggle("no-stop", !about.can_stop);
  if (about.live) startLive(); else startRecorded();
}
start();
