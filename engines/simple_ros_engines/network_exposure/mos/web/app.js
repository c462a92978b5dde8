"use strict";
const at = (id) => document.getElementById(id);
const ticked = new Set();
let socket = null;
let drawnGroups = "";
let isGrouping = false;

function make(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined && text !== null) made.textContent = text;
  if (className) made.className = className;
  return made;
}

function say(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function rows(table, titles, items) {
  const head = make("tr");
  for (const title of titles) head.append(make("th", title));
  table.replaceChildren(head, ...items);
}

function button(text, label, className, message) {
  const made = make("button", text, className);
  made.type = "button";
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", () => say(message));
  return made;
}

function showTopics(topics) {
  at("no-topics").hidden = topics.length > 0;
  const old = new Map([...at("topics").querySelectorAll("input")].map((box) => [box.value, box]));
  rows(at("topics"), ["", "Topic", "Score", "Network", "Hz", "B/s", "Jitter (ms)"], topics.map((topic) => {
    const row = make("tr", null, topic.flowing ? "" : "silent");
    let box = old.get(topic.name);
    if (!box) {
      box = make("input");
      box.type = "checkbox";
      box.value = topic.name;
      box.setAttribute("aria-label", topic.name);
      box.addEventListener("change", () => box.checked ? ticked.add(box.value) : ticked.delete(box.value));
    }
    box.checked = ticked.has(topic.name);
    const cell = make("td");
    cell.append(box);
    const by = topic.judge === "human" ? " ★" : "";
    const score = topic.score === null ? "" : topic.score.toFixed(2) + by;
    row.append(cell, make("td", topic.name), make("td", score, topic.score !== null && topic.score < 3.5 ? "bad" : ""),
      make("td", topic.network, topic.network.includes("instead") || topic.network === "failed" ? "bad" : ""),
      make("td", topic.rate.toFixed(1)), make("td", topic.bandwidth), make("td", topic.jitter_ms.toFixed(1)));
    return row;
  }));
}

function showGroups(groups) {
  at("no-groups").hidden = groups.length > 0;
  const now = JSON.stringify(groups);
  if (now === drawnGroups) return;
  drawnGroups = now;
  at("groups").replaceChildren(...groups.map((group) => {
    const box = make("div", null, "group");
    box.dataset.group = group.name;
    box.append(make("h3", group.name), make("p", group.topics.join(", ")));
    for (let stars = 1; stars <= 5; stars++) {
      const label = stars + " of 5 for " + group.name;
      const on = stars <= group.stars ? "star on" : "star";
      box.append(button("★", label, on, { op: "rate", name: group.name, stars: stars }));
    }
    box.append(button("Take back", "", "", { op: "withdraw", name: group.name }),
      button("Ungroup", "", "", { op: "ungroup", name: group.name }));
    return box;
  }));
}

function showScores(scores) {
  rows(at("scores"), ["Group", "Score", "By"], scores.map((score) => {
    const row = make("tr");
    row.append(make("td", score.group), make("td", score.score.toFixed(2)), make("td", score.judge));
    return row;
  }));
}

function showAsked(asked) {
  at("nobody-asked").hidden = asked.length > 0;
  const percent = (factor) => Math.round(100 * factor) + " %";
  rows(at("asked"), asked.length ? ["Group", "Speed", "Rate", "Why"] : [], asked.map((one) => {
    const row = make("tr");
    row.append(make("td", one.group), make("td", percent(one.speed)), make("td", percent(one.rate)),
      make("td", one.reason, "wrap"));
    return row;
  }));
}

function came(message) {
  if (message.op === "answer") {
    at("answer").textContent = message.message;
    at("answer").className = message.ok ? "" : "bad";
    if (isGrouping && message.ok) {
      ticked.clear();
      at("group-name").value = "";
    }
    isGrouping = false;
    return;
  }
  at("simulated").hidden = !message.simulated;
  showTopics(message.topics);
  showGroups(message.groups);
  showScores(message.scores);
  showAsked(message.asked);
}

function connect() {
  socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/[?#].*$/, "").replace(/\/[^/]*$/, "/feed"));
  socket.addEventListener("message", (event) => came(JSON.parse(event.data)));
  socket.addEventListener("open", () => {
    at("connection").textContent = "live";
    at("connection").className = "badge good";
  });
  socket.addEventListener("close", () => {
    at("connection").textContent = "not connected";
    at("connection").className = "badge bad";
    setTimeout(connect, 1000);
  });
}

at("new-group").addEventListener("submit", (event) => {
  event.preventDefault();
  isGrouping = true;
  say({ op: "group", name: at("group-name").value, topics: [...ticked] });
});
connect();
