"use strict";
const at = (id) => document.getElementById(id);
const MODES = ["realtime", "burst", "optimized"];
const ENGINES = ["radio_info_engine", "cross_domain_engine", "physical_adaptive_engine"];
const NAMES = {
  avg_bler: "Block errors", avg_throughput: "Throughput (Mbit/s)", avg_latency: "Latency (ms)",
  resource_utilization: "Resources in use", successful_transmissions: "Transmissions that succeeded",
  failed_transmissions: "Transmissions that failed", counted: "Transmissions are",
};
let socket = null;
let grid = null;

function make(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined && text !== null) made.textContent = text;
  if (className) made.className = className;
  return made;
}

function badge(id, text, kind) {
  at(id).textContent = text;
  at(id).className = "badge " + kind;
}

function say(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function choice(options, value, chosen) {
  const select = make("select");
  for (const option of options) select.append(make("option", option));
  select.value = value;
  select.addEventListener("change", () => { chosen(select.value); select.blur(); });
  return select;
}

function rows(table, titles, items) {
  const head = make("tr");
  for (const title of titles) head.append(make("th", title));
  table.replaceChildren(head, ...items);
}

function cell(row, title, text, className) {
  const made = make("td", text, className);
  made.dataset.title = title;
  row.append(made);
  return made;
}

/* Rows stay as long as their component: a button must not be replaced under somebody's finger. */
const componentRows = new Map();
const KINDS = { active: "good", starting: "warn", waiting: "warn", degraded: "warn", stopped: "warn" };

function componentRow(item) {
  const row = make("tr");
  row.id = "component-" + item.name;
  cell(row, "", item.name, "name");
  const made = { row, state: cell(row, "State") };
  const mode = cell(row, "Mode");
  if (ENGINES.includes(item.name)) {
    made.mode = choice(MODES, item.mode, (value) => say({ op: "mode", engine: item.name, mode: value }));
    made.mode.setAttribute("aria-label", "Mode of " + item.name);
    mode.append(made.mode);
  }
  made.button = make("button");
  made.button.addEventListener("click", () => say({ op: "component", name: item.name, action: made.button.textContent }));
  cell(row, "").append(made.button);
  made.cpu = cell(row, "CPU");
  made.memory = cell(row, "MB");
  made.restarts = cell(row, "Restarts");
  made.message = cell(row, "", "", "message");
  return made;
}

function put(element, text) {
  if (element.textContent !== String(text)) element.textContent = text;
}

function showComponents(components) {
  const names = components.map((item) => item.name).join();
  if (at("components").dataset.names !== names) {
    componentRows.clear();
    for (const item of components) componentRows.set(item.name, componentRow(item));
    rows(at("components"), ["Name", "State", "Mode", "", "CPU", "MB", "Restarts", ""],
      [...componentRows.values()].map((made) => made.row));
    at("components").dataset.names = names;
  }
  for (const item of components) {
    const made = componentRows.get(item.name);
    put(made.state, item.state);
    made.state.className = (KINDS[item.state] || "bad") + "-text";
    if (made.mode) {
      made.mode.disabled = !MODES.includes(item.mode);
      if (document.activeElement !== made.mode) made.mode.value = item.mode;
    }
    put(made.button, ["stopped", "given up"].includes(item.state) ? "start" : "stop");
    put(made.cpu, item.cpu_percent + " %");
    put(made.memory, item.memory_mb);
    put(made.restarts, item.restarts);
    put(made.message, item.message);
  }
}

function showLinks(links) {
  const titles = ["Link", "Quality", "SNR (dB)", "Errors", "RTT (ms)", "Mbit/s", "could"];
  rows(at("links"), titles, links.map((link) => {
    const row = make("tr");
    const values = [link.link, link.quality, link.snr_db, link.bler, link.rtt_ms, link.mbps, link.available_mbps];
    values.forEach((value, index) => cell(row, index ? titles[index] : "", value === null ? "–" : value, index ? "" : "name"));
    return row;
  }));
}

function showShares(shares) {
  at("shares-text").textContent = `${shares.granted} of ${shares.total} given, ${shares.requested} wanted, ` +
    `Jain's index ${shares.jain}` + (shares.floors_scaled ? ", floors scaled" : "");
  const bars = shares.grants.map((grant) => {
    const share = make("div", null, "share");
    share.append(make("div", `${grant.link}: ${grant.granted} of ${grant.wanted} (priority ${grant.priority}, ${grant.mbps} Mbit/s)`));
    const track = make("div", null, "track");
    for (const kind of ["wanted", "granted"]) {
      const bar = make("div", null, kind);
      bar.style.width = Math.min(100, 100 * grant[kind] / Math.max(1, shares.total)) + "%";
      track.append(bar);
    }
    share.append(track);
    return share;
  });
  const refused = Object.entries(shares.refused).map(([link, why]) => make("div", `${link} refused: ${why}`, "bad-text"));
  at("shares").replaceChildren(...bars, ...refused);
}

function showPolicy(policy) {
  const select = at("policy");
  if (document.activeElement === select) return;
  const options = ["chosen by the hub", ...policy.known];
  if (select.options.length !== options.length) select.replaceChildren(...options.map((name) => make("option", name)));
  select.value = policy.pinned ? policy.name : options[0];
  select.options[0].textContent = policy.pinned ? options[0] : `chosen by the hub: ${policy.name}`;
  if (!policy.pinned) select.selectedIndex = 0;
}

function showPerformance(performance) {
  at("performance").replaceChildren(...Object.entries(performance).flatMap(([name, value]) =>
    [make("dt", NAMES[name] || name), make("dd", value)]));
}

function showEvents(events) {
  const list = at("events");
  for (const event of events) {
    const item = make("li", null, event.is_error ? "bad-text" : "");
    item.value = event.number;
    item.append(make("time", new Date(event.time_s * 1000).toLocaleTimeString()), event.text);
    list.prepend(item);
  }
  while (list.children.length > 200) list.lastChild.remove();
}

function mapImage() {
  const image = new ImageData(grid.width, grid.height);
  const cells = atob(grid.cells);
  for (let y = 0; y < grid.height; y++) {
    for (let x = 0; x < grid.width; x++) {
      const value = cells.charCodeAt(y * grid.width + x);
      const to = 4 * ((grid.height - 1 - y) * grid.width + x);
      const cost = Math.min(1, Math.max(0, value - 1) / 49);
      const color = value === 0 ? [128, 128, 128] : value > 99 ? [20, 20, 20] : [40 + 200 * cost, 190 - 150 * cost, 70];
      image.data.set([...color, 255], to);
    }
  }
  return image;
}

function showMap(pose) {
  at("map-section").hidden = !grid;
  if (!grid) return;
  const zoom = Math.max(1, Math.floor(400 / Math.max(grid.width, grid.height)));
  const plain = new OffscreenCanvas(grid.width, grid.height);
  plain.getContext("2d").putImageData(mapImage(), 0, 0);
  const canvas = at("map");
  canvas.width = grid.width * zoom;
  canvas.height = grid.height * zoom;
  const context = canvas.getContext("2d");
  context.imageSmoothingEnabled = false;
  context.drawImage(plain, 0, 0, canvas.width, canvas.height);
  at("map-text").textContent = pose ? `Robot at ${pose[0].toFixed(1)}, ${pose[1].toFixed(1)} m` : "Nobody says where the robot is.";
  if (!pose) return;
  const x = zoom * (pose[0] - grid.origin[0]) / grid.resolution;
  const y = canvas.height - zoom * (pose[1] - grid.origin[1]) / grid.resolution;
  for (const [size, color] of [[7, "#fff"], [5, "#06f"]]) {
    context.fillStyle = color;
    context.beginPath();
    context.arc(x, y, size, 0, 2 * Math.PI);
    context.fill();
  }
}

function show(state) {
  badge("phase", state.phase.toLowerCase() + (state.degraded ? ", degraded" : ""), state.degraded ? "bad" : "good");
  badge("level", "level " + state.level.name.toLowerCase(), ["good", "warn", "bad", "bad"][state.level.number]);
  at("level").title = state.level.reason;
  at("reasons").textContent = state.reasons.join("; ");
  showPolicy(state.policy);
  showPerformance(state.performance);
  showComponents(state.components);
  showLinks(state.links);
  showShares(state.shares);
  showEvents(state.events);
  if ("map" in state) grid = state.map;
  showMap(state.pose);
}

function answered(answer) {
  at("answer").textContent = answer.message;
  at("answer").className = answer.ok ? "" : "bad-text";
  clearTimeout(answered.timer);
  answered.timer = setTimeout(() => { at("answer").textContent = ""; }, 4000);
}

function connect() {
  socket = new WebSocket(location.origin.replace(/^http/, "ws") + "/feed");
  socket.addEventListener("open", () => {
    badge("connection", "live", "good");
    at("events").replaceChildren();
  });
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    if (message.op === "state") show(message);
    else answered(message);
  });
  socket.addEventListener("close", () => {
    badge("connection", "not connected", "bad");
    setTimeout(connect, 1000);
  });
}

at("policy").addEventListener("change", () => {
  const select = at("policy");
  say({ op: "policy", policy: select.selectedIndex === 0 ? "" : select.value });
  select.blur();
});
connect();
